"""One CAN adapter on a serial line for several handles: a serial line has one reader, a CAN bus has many."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import can

#: Frames that a handle which does not read lets pile up: what `canbus.drain` takes, and one so that it sees a pile.
ROOM = 513
#: Errors in a row after which an adapter is not there any more: whoever comes then opens it anew.
_GONE = 16


class SharedBus(can.BusABC):  # type: ignore[misc]  # python-can is not read by mypy
    """One handle's place on an adapter. It hears what the adapter hears, and what the others on it send.

    Made by `share`.
    """

    def __init__(self, adapter: _Adapter) -> None:
        self._adapter = adapter
        self.heard: deque[can.Message] = deque(maxlen=ROOM)
        adapter.places.append(self)
        super().__init__(channel=adapter.key)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send for this place; the others hear it, as they would on a bus of wires."""
        self._adapter.bus.send(msg, timeout)
        for place in self._adapter.places:
            if place is not self:
                place.heard.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self.heard:
            self._adapter.listen()
        return (self.heard.popleft() if self.heard else None), True

    def shutdown(self) -> None:
        """Leave the adapter; the last one closes it."""
        super().shutdown()
        self._adapter.leave(self)


class _Adapter:
    """An open adapter, and who is on it."""

    def __init__(self, key: str, settings: dict[str, Any], bus: can.BusABC) -> None:
        self.key, self.settings, self.bus = key, settings, bus
        self.places: list[SharedBus] = []
        self._errors = 0

    @property
    def is_gone(self) -> bool:
        """Whether nothing but errors has come of it lately, as of one that was pulled out."""
        return self._errors >= _GONE

    def listen(self) -> None:
        """Hand the next frame that has come to everybody, without waiting."""
        self._errors += 1
        message = self.bus.recv(0.0)
        self._errors = 0
        if message is not None:
            for place in self.places:
                place.heard.append(message)

    def leave(self, place: SharedBus) -> None:
        with _opening:  # another may just be taking its place here
            if place not in self.places:
                return
            self.places.remove(place)
            if self.places:
                return
            if _open.get(self.key) is self:  # else one that was pulled out, and is back
                del _open[self.key]
            self.bus.shutdown()


_open: dict[str, _Adapter] = {}
#: Of one thread more than once: a place that nobody keeps is given up wherever that thread is.
_opening = threading.RLock()


def share(settings: dict[str, Any], open_adapter: Callable[..., can.BusABC]) -> SharedBus:
    """Return a place on the adapter at ``settings["channel"]``, which is opened with `settings` by the first.

    One that is gone is opened anew, whoever is still on it.
    Raises ValueError if it is open with other settings: an adapter has one bit rate.
    """
    key = os.path.realpath(str(settings["channel"]))
    with _opening:  # two handles may look for theirs at once
        adapter = _open.get(key)
        if adapter is None or adapter.is_gone:
            adapter = _open[key] = _Adapter(key, settings, open_adapter(**settings))
        elif adapter.settings != settings:
            raise ValueError(f"it is in use with other settings, {adapter.settings}")
        return SharedBus(adapter)
