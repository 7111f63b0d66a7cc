"""The gateway's use of python-can: opening with a clear error message, and draining without waiting."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Iterator
from typing import Any

import can

from trocar.services.gateway.can.shared_bus import SharedBus, share
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.errors import DeviceError

#: Most frames of one `drain`: the backlog of half a second, and a bound on a tick's time.
DRAIN_LIMIT = 512
DEFAULT_BITRATE = 1e6  # ISO 11898: the most of classic CAN
#: Errors in a row, of unreadable frames or a lost bus, after which a `drain` ends.
_STRANGE_LIMIT = 16

#: Set to 1, it permits a bus without authentication of senders.
OPEN_BUS = "TROCAR_TEST_OPEN_BUS"

#: Keys of python-can's interfaces, except those that pass settings on to a vendor's library.
KEYS = {
    "socketcan": ("channel", "receive_own_messages", "local_loopback", "fd", "ignore_rx_error_frames"),
    "slcan": ("channel", "tty_baudrate", "sleep_after_open", "rtscts", "listen_only", "timeout"),
    "udp_multicast": ("channel", "port", "hop_limit", "receive_own_messages", "fd"),
    "virtual": ("channel", "receive_own_messages", "rx_queue_size", "preserve_timestamps"),
}

# python-can would also warn about not closing a bus that could not be opened.
logging.getLogger("can").setLevel(logging.ERROR)


def open_bus(settings: dict[str, Any], where: str) -> can.BusABC:
    """Open the bus of python-can's `settings` (interface, channel, ...).

    No filters are set, because python-can's software filters make a non-blocking `recv` stop early.
    Raises DeviceError: one sentence, for any error of python-can or the system.
    """
    try:
        if settings.get("interface") == "slcan":
            return _open_slcan({name: value for name, value in settings.items() if name != "interface"})
        return can.Bus(**settings)
    except Exception as error:  # plug-ins raise anything: termios.error is not even an OSError
        raise DeviceError(f"{where}: CAN bus {_name(settings)} cannot be opened: {error}") from None


def _open_slcan(settings: dict[str, Any]) -> can.BusABC:
    try:
        import serial  # noqa: F401
    except ImportError:
        raise ImportError("slcan needs pyserial, which is not installed") from None
    from trocar.services.gateway.can.slcan import SlcanBus  # only here: python-can reports a missing pyserial itself

    return share(settings, SlcanBus)


def check_keys(settings: dict[str, Any]) -> None:
    """Reject keys unknown to the interface, which python-can would silently replace by its defaults.

    Raises ValueError naming the unknown key, or a missing one.
    """
    if "interface" not in settings:
        raise ValueError(f"interface: this key is missing; given: {', '.join(map(str, settings)) or 'none'}")
    known = KEYS.get(str(settings["interface"]))
    if known is None:  # a vendor's library
        return
    known = ("interface", "bitrate", *known)
    unknown = next((key for key in settings if key not in known), None)
    if unknown is not None:
        raise ValueError(f"unknown key {unknown!r}; known: {', '.join(known)}{did_you_mean(unknown, known)}")
    if settings["interface"] == "udp_multicast" and os.environ.get(OPEN_BUS) != "1":
        raise ValueError(
            "interface: on udp_multicast everybody on the network can move the handle; use socketcan or slcan, or for "
            f"a test without a hand set {OPEN_BUS}=1"
        )
    if "channel" not in settings:  # otherwise socketcan would use all buses of the machine
        raise ValueError("channel: this key is missing")


def bitrate(settings: dict[str, Any]) -> float:
    """Return the bit rate of a bus in bit/s, by default 1 Mbit/s.

    Raises ValueError if it is not a finite number.
    """
    said = settings.get("bitrate", DEFAULT_BITRATE)
    if isinstance(said, bool) or not isinstance(said, int | float) or not math.isfinite(said):
        raise ValueError(f"bitrate must be a number of bit/s, is {said!r}")
    return float(said)


def noise(bus: can.BusABC) -> str:
    """Return a phrase on what came over a serial line and is no frame, empty if nothing did."""
    lines = bus.strange if isinstance(bus, SharedBus) else 0
    return (
        f"{lines} lines came that are no frames: look at the adapter's protocol (slcan) and baud rate" if lines else ""
    )


def drain(bus: can.BusABC) -> Iterator[can.Message]:
    """Yield received frames, oldest first, without waiting; anything that is not a CAN frame is skipped.

    A failed bus yields nothing; callers detect that by the age of the last frame.
    """
    strange = 0
    for _ in range(DRAIN_LIMIT):
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
