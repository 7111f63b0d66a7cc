"""Who may move the instruments from a page, and what comes of nonsense."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json

import pytest

from trocar.protocol import bodies
from trocar.services.visualization.page_hands import REFUSED, TAKEN_OVER, PageHands

TOKEN = "what trocar up printed"
AT = bodies.InstrumentState(name="left", position_m=(0.1, 0.2, 0.3), roll_rad=0.4)
OTHER = bodies.InstrumentState(name="right", position_m=(0.0, 0.0, 0.0))
ROW = ["left", [0.01, 0.02, 0.03], 0.5, 1.0]


class GoneError(Exception):
    """The page has closed its connection."""


class Page:
    """A connection that says some messages and then goes, or stays."""

    def __init__(self, *messages: object, stays: bool = False) -> None:
        self.messages = [m if isinstance(m, str) else json.dumps(m) for m in messages]
        self.heard: list[dict[str, object]] = []
        self.closed: tuple[int, str] | None = None
        self.stays = stays
        self.ended = asyncio.Event()

    async def receive_text(self) -> str:
        if self.messages:
            return self.messages.pop(0)
        if self.stays:
            await self.ended.wait()
        raise GoneError

    async def send_text(self, data: str) -> None:
        self.heard.append(json.loads(data))

    async def close(self, code: int, reason: str) -> None:
        self.closed = (code, reason)
        self.ended.set()


class Rig:
    def __init__(self, *followers: str) -> None:
        self.published: list[bodies.Hands] = []
        self.devices = bodies.GatewayState(tick=0, instruments=(AT, OTHER), begins=3)
        self.token_sha256 = hashlib.sha256(TOKEN.encode()).hexdigest()
        self.hands = PageHands(followers, self.published.append, lambda: self.devices, lambda: self.token_sha256)

    def serve(self, page: Page) -> None:
        async def run() -> None:
            with contextlib.suppress(GoneError):
                await self.hands.serve(page)

        asyncio.run(run())


def test_a_page_with_the_token_is_told_where_its_tools_are_and_moves_them() -> None:
    rig, page = Rig("left"), Page(TOKEN, [[ROW]])
    rig.serve(page)
    (greeting,) = page.heard
    assert greeting["tools"] == [{"name": "left", "position_m": [0.1, 0.2, 0.3], "roll_rad": 0.4}]
    (body,) = rig.published
    assert body.hands == (bodies.HandTarget(name="left", position_m=(0.01, 0.02, 0.03), roll_rad=0.5, opening=1.0),)


def test_a_page_is_greeted_again_where_the_scene_has_begun_again_and_says_of_which_beginning_its_hands_are() -> None:
    rig = Rig("left")
    back = bodies.InstrumentState(name="left", position_m=(0.4, 0.5, 0.6))

    class Slow(Page):
        async def receive_text(self) -> str:
            if len(self.messages) == 1:
                rig.devices = bodies.GatewayState(tick=0, instruments=(back, OTHER), begins=4)
            return await super().receive_text()

    page = Slow(TOKEN, [[ROW], 3], [[ROW], 3], [[ROW], 4])
    rig.serve(page)
    assert [each["begins"] for each in page.heard] == [3, 4]
    assert page.heard[1]["tools"][0]["position_m"] == [0.4, 0.5, 0.6]  # type: ignore[index]
    assert [each.begins for each in rig.published] == [3, 3, 4]


@pytest.mark.parametrize("token", ["", "guess", TOKEN + " ", TOKEN.upper(), "\ud800"])
def test_without_the_token_nothing_moves(token: str) -> None:
    rig, page = Rig("left"), Page(token, [[ROW]])
    rig.serve(page)
    assert rig.published == []
    assert page.heard == []
    assert page.closed is not None
    assert page.closed[0] == REFUSED
    assert "token" in page.closed[1]


def test_while_no_supervisor_tells_the_token_nobody_is_let_in() -> None:
    rig, page = Rig("left"), Page("")
    rig.token_sha256 = ""
    rig.serve(page)
    assert page.closed is not None
    assert page.closed[0] == REFUSED


def test_a_rig_whose_instruments_are_in_other_hands_says_so() -> None:
    rig, page = Rig(), Page(TOKEN)
    rig.serve(page)
    assert page.closed == (REFUSED, "no instrument of this rig follows the page (driver: web)")


@pytest.mark.parametrize(
    "nonsense",
    ["", "{", [], [[["left"]]], [[["left", [1, 2], 0, 0]]], [[["left", [1, 2, None], 0, 0]]], [[ROW] * 9],
     '[[["left",[1e999,0,0],0,0]]]', '[[["left",[NaN,0,0],0,0]]]', [[["x" * 65, [0, 0, 0], 0, 0]]]],
)  # fmt: skip
def test_nonsense_is_counted_and_what_follows_is_heard(nonsense: object) -> None:
    rig = Rig("left")
    rig.serve(Page(TOKEN, nonsense, [[ROW]]))
    assert len(rig.published) <= 2
    assert rig.published[-1].hands[0].name == "left"
    assert rig.hands.refused == 1 or rig.published[0] == bodies.Hands()


def test_a_newer_page_takes_over_and_the_older_is_told() -> None:
    rig, first, second = Rig("left"), Page(TOKEN, stays=True), Page(TOKEN, [[ROW]], stays=True)

    async def both() -> None:
        serving = asyncio.create_task(rig.hands.serve(first))
        await asyncio.sleep(0)
        taking = asyncio.create_task(rig.hands.serve(second))
        with pytest.raises(GoneError):
            await serving
        assert first.closed is not None
        assert first.closed[0] == TAKEN_OVER
        second.ended.set()
        with pytest.raises(GoneError):
            await taking

    asyncio.run(both())
    assert len(rig.published) == 1
    assert second.closed is None


class Hung(Page):
    """A page whose browser stands still: what is sent to it waits, and closing it does, too."""

    def __init__(self, *messages: object) -> None:
        super().__init__(*messages, stays=True)
        self.wakes = asyncio.Event()

    async def close(self, code: int, reason: str) -> None:
        self.closed = (code, reason)
        await self.wakes.wait()

    async def receive_text(self) -> str:
        if not self.messages:
            await self.wakes.wait()
            return json.dumps([[ROW]])
        return self.messages.pop(0)


def test_a_page_that_was_taken_over_publishes_nothing_more_and_cannot_block_the_new_one() -> None:
    """Its last message was on its way when the newer page came, and its connection does not end."""
    rig, hung, newer = Rig("left"), Hung(TOKEN), Page(TOKEN, [[[*ROW[:2], 0.7, 1.0]]], stays=True)

    async def both() -> None:
        hanging = asyncio.create_task(rig.hands.serve(hung))
        await asyncio.sleep(0)
        taking = asyncio.create_task(rig.hands.serve(newer))
        for _ in range(5):
            await asyncio.sleep(0)
        assert [body.hands[0].roll_rad for body in rig.published] == [0.7], "the newer one is served at once"
        assert hung.closed is not None
        assert hung.closed[0] == TAKEN_OVER
        hung.wakes.set()
        await hanging
        assert len(rig.published) == 1
        newer.ended.set()
        with pytest.raises(GoneError):
            await taking

    asyncio.run(both())
