"""A renderer that starts slowly: a request is answered soon, and the renderer goes on for the next one."""

from __future__ import annotations

import asyncio

import pytest

from tests.visualization.test_view_codec import a_layout, a_picture
from trocar.services.visualization import camera_feed, codec
from trocar.services.visualization.camera_feed import CameraFeed
from trocar.services.visualization.feed import FeedMessage


def _feed(monkeypatch: pytest.MonkeyPatch, starts_in_s: float) -> tuple[CameraFeed, list[str]]:
    layout, feed, drawn = a_layout(), CameraFeed(), []
    picture = a_picture(layout)
    feed.offer(FeedMessage(picture.epoch, codec.encode_hello(layout), 1, 1, codec.encode(picture, 1)))
    wait_s = [starts_in_s]

    async def render(_message: FeedMessage, kind: str) -> bytes:
        await asyncio.sleep(wait_s[0])
        wait_s[0] = 0.0
        drawn.append(kind)
        return kind.encode()

    monkeypatch.setattr(feed, "_render", render)
    return feed, drawn


def test_a_request_is_told_soon_that_the_renderer_still_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """It ended in 503 after 32 s, and each request began anew with what the last one had waited for."""
    monkeypatch.setattr(camera_feed, "_ANSWER_S", 0.1)
    feed, drawn = _feed(monkeypatch, 0.5)

    async def ask() -> tuple[bytes | None, bytes | None]:
        first = await feed.image("png")
        assert drawn == []
        assert "still starting; ask again" in feed.fault
        await asyncio.sleep(0.6)
        second = await feed.image("png")
        await feed.close()
        return first, second

    assert asyncio.run(ask()) == (None, b"png")
    assert drawn == ["png", "png"], "what nobody waited for is old, and not shown"


def test_who_asks_at_once_for_different_kinds_gets_them(monkeypatch: pytest.MonkeyPatch) -> None:
    feed, _ = _feed(monkeypatch, 0.0)

    async def ask() -> list[bytes | None]:
        answers = await asyncio.gather(*(feed.image(kind) for kind in ("png", "jpeg", "png", "jpeg")))
        await feed.close()
        return list(answers)

    assert asyncio.run(ask()) == [b"png", b"jpeg", b"png", b"jpeg"]
