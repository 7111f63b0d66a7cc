"""Control of instruments at the page: permission, and targets on their way to the gateway.

A page authenticates with the session's token, which is part of the printed address. One page controls the instruments;
a newer one takes over. It sends bodies of ``visualization.hands`` as JSON.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
from collections.abc import Callable, Collection
from typing import Protocol

import msgspec

from trocar.protocol import bodies
from trocar.protocol.topics import topic

#: WebSocket close codes for the page: not allowed, and taken over by another page.
REFUSED, TAKEN_OVER = 4003, 4001
TOPIC = "visualization.hands"
_DECODER = msgspec.json.Decoder(bodies.Hands)


class PageConnection(Protocol):
    """A connection to a page."""

    async def receive_text(self) -> str:
        """Return the next message; raises an exception that ends `PageHands.serve` if the page is gone."""
        ...

    async def send_text(self, data: str) -> None:
        """Send a message; raises as `receive_text`."""
        ...

    async def close(self, code: int, reason: str) -> None:
        """Close the connection, which may take long; raises nothing if it is gone already."""
        ...


class PageHands:
    """Lets a page control the instruments that follow it.

    Args:
        followers: Names of the instruments with a page's driver.
        publish: Called with a page's targets.
        devices: Returns the gateway's last state, None before the first, with the instruments' poses for a page at its
            start and after a restart of the scene.
        token_sha256: Returns the hash of the session's token from the supervisor, empty while unknown.
    """

    def __init__(
        self,
        followers: Collection[str],
        publish: Callable[[bodies.Hands], object],
        devices: Callable[[], bodies.GatewayState | None],
        token_sha256: Callable[[], str],
    ) -> None:
        self.followers = frozenset(followers)
        self.refused = 0
        self._publish = publish
        self._devices = devices
        self._token_sha256 = token_sha256
        self._holder: PageConnection | None = None
        self._closing: set[asyncio.Task[None]] = set()

    async def serve(self, page: PageConnection) -> None:
        """Serve one page until it disconnects or another takes over."""
        reason = self._refusal(await page.receive_text())
        if reason:
            await page.close(REFUSED, reason)
            return
        former, self._holder = self._holder, page
        if former is not None:  # not awaited, as its browser may be suspended
            closing = asyncio.create_task(former.close(TAKEN_OVER, "another page has taken the instruments"))
            self._closing.add(closing)
            closing.add_done_callback(self._closing.discard)
        try:
            greeted: int | None = None
            while self._holder is page:
                devices = self._devices()
                if greeted is None or (devices is not None and devices.begins != greeted):
                    greeted = devices.begins if devices is not None else 0
                    await page.send_text(_greeting(self._tools(devices), greeted))
                text = await page.receive_text()
                if self._holder is page:  # otherwise it was sent before a newer page took over
                    self._take_message(text)
        finally:
            if self._holder is page:
                self._holder = None

    def _refusal(self, token: str) -> str:
        """Return why `token` does not permit control, empty if it does."""
        if not self.followers:
            return "no instrument of this rig follows the page (driver: web)"
        known = self._token_sha256()
        given = hashlib.sha256(token.encode("utf-8", "replace")).hexdigest()
        if not known or not hmac.compare_digest(known, given):
            return "the rig does not know this token: open the address that trocar up printed"
        return ""

    def _tools(self, devices: bodies.GatewayState | None) -> list[dict[str, object]]:
        return [
            {"name": each.name, "position_m": each.position_m, "roll_rad": each.roll_rad}
            for each in (devices.instruments if devices is not None else ())
            if each.name in self.followers
        ]

    def _take_message(self, text: str) -> None:
        try:
            body = _DECODER.decode(text)
        except (msgspec.DecodeError, msgspec.ValidationError):
            self.refused += 1
            return
        self._publish(body)


def _greeting(tools: list[dict[str, object]], begins: int) -> str:
    return json.dumps({"type": "hands", "rate_hz": topic(TOPIC).rate_hz, "tools": tools, "begins": begins})
