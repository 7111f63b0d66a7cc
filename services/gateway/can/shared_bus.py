"""One CAN adapter on a serial line shared by several handles, since a serial line has only one reader."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import can

#: Queue length of a handle that does not read: the limit of `canbus.drain`, plus one so that it detects a backlog.
ROOM = 513
#: Errors in a row after which an adapter counts as lost and is reopened by the next user.
_GONE = 16


class SharedBus(can.BusABC):  # type: ignore[misc]  # python-can is not read by mypy
    """One handle's bus on an adapter. It receives the adapter's frames and those sent by the other handles.

    Created by `share`.
    """

    def __init__(self, adapter: _Adapter) -> None:
        self._adapter = adapter
        self.heard: deque[can.Message] = deque(maxlen=ROOM)
        adapter.places.append(self)
        super().__init__(channel=adapter.key)

    @property
    def strange(self) -> int:
        """Number of lines of the adapter so far that are neither a frame nor an answer."""
        return int(getattr(self._adapter.bus, "strange", 0))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; the other handles receive it, as on a physical bus."""
        self._adapter.bus.send(msg, timeout)
        for place in self._adapter.places:
            if place is not self:
                place.heard.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self.heard:
            self._adapter.listen()
        return (self.heard.popleft() if self.heard else None), True

    def shutdown(self) -> None:
        """Leave the adapter; the last handle closes it."""
        super().shutdown()
        self._adapter.leave(self)


class _Adapter:
    """An open adapter, and its buses."""

    def __init__(self, key: str, settings: dict[str, Any], bus: can.BusABC) -> None:
        self.key, self.settings, self.bus = key, settings, bus
        self.places: list[SharedBus] = []
        self._errors = 0

    @property
    def is_gone(self) -> bool:
        """Whether it lately gave only errors, as an unplugged one does."""
        return self._errors >= _GONE

    def listen(self) -> None:
        """Pass the next received frame to all buses, without waiting."""
        self._errors += 1
        message = self.bus.recv(0.0)
        self._errors = 0
        if message is not None:
            for place in self.places:
                place.heard.append(message)

    def leave(self, place: SharedBus) -> None:
        with _opening:  # another handle may be joining
            if place not in self.places:
                return
            self.places.remove(place)
            if self.places:
                return
            if _open.get(self.key) is self:  # otherwise it has been replaced after unplugging
                del _open[self.key]
            self.bus.shutdown()


_open: dict[str, _Adapter] = {}
#: Reentrant, because the garbage collector may shut a bus down at any point of the thread.
_opening = threading.RLock()


def share(settings: dict[str, Any], open_adapter: Callable[..., can.BusABC]) -> SharedBus:
    """Return a bus on the adapter at ``settings["channel"]``, which the first call opens with `settings`.

    A lost adapter is reopened, whoever still uses it.
    Raises ValueError if it is open with other settings, as an adapter has one bit rate.
    """
    key = os.path.realpath(str(settings["channel"]))
    with _opening:  # two handles may call this at once
        adapter = _open.get(key)
        if adapter is None or adapter.is_gone:
            adapter = _open[key] = _Adapter(key, settings, open_adapter(**settings))
        elif adapter.settings != settings:
            raise ValueError(f"it is in use with other settings, {adapter.settings}")
        return SharedBus(adapter)
