"""python-can as the gateway uses it: opened with one clear sentence, drained without waiting."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import socket
from collections.abc import Iterator
from typing import Any

import can

from services.runtime.errors import DeviceError

#: Frames taken by one `drain`: what a stall of half a second leaves behind, and a bound on a tick's time.
_DRAIN_LIMIT = 512
#: Datagrams that are not CAN frames and are passed over by one `drain`.
_STRANGE_LIMIT = 16
_RECEIVE_BUFFER = 1 << 20

# A bus that could not be opened would also complain that nobody closed it.
logging.getLogger("can").setLevel(logging.ERROR)


def open_bus(settings: dict[str, Any], where: str) -> can.BusABC:
    """Return the bus that `settings` (python-can's own: interface, channel, ...) name.

    No filters are set: those of python-can's software kind make a non-blocking `recv` stop early.

    Raises
    ------
    DeviceError
        one sentence, whatever python-can or the system says.
    """
    try:
        bus = can.Bus(**settings)
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise DeviceError(f"{where}: CAN bus {_name(settings)} cannot be opened: {_reason(error)}") from None
    if settings.get("interface") == "udp_multicast":
        _enlarge_buffer(bus)
    return bus


def drain(bus: can.BusABC) -> Iterator[can.Message]:
    """Yield what has arrived, oldest first, without waiting; what is not a CAN frame is passed over.

    A bus that has failed yields nothing: whoever listens judges by the age of what it heard last.
    """
    strange = 0
    for _ in range(_DRAIN_LIMIT):
        try:
            message = bus.recv(0.0)
        except can.CanOperationError:
            strange += 1
            if strange >= _STRANGE_LIMIT:
                return
            continue
        if message is None:
            return
        yield message


def _name(settings: dict[str, Any]) -> str:
    return " ".join(str(settings[key]) for key in ("interface", "channel", "port") if key in settings)


def _reason(error: BaseException) -> str:
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError) and cause.errno == errno.ENODEV:
            return "there is no route for multicast; `ip route add 239.0.0.0/8 dev lo` makes one"
        cause = cause.__cause__ or cause.__context__
    return str(error)


def _enlarge_buffer(bus: can.BusABC) -> None:
    # The default holds 256 frames and keeps the oldest: a reader that was held up would read the past.
    with contextlib.closing(socket.socket(fileno=os.dup(bus.fileno()))) as handle:
        handle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
