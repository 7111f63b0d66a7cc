"""python-can as the gateway uses it: opened with one clear sentence, drained without waiting."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Iterator
from typing import Any

import can

from services.gateway.shared_bus import share
from services.nearest_word import did_you_mean
from services.runtime.errors import DeviceError

#: Frames taken by one `drain`: what a stall of half a second leaves behind, and a bound on a tick's time.
DRAIN_LIMIT = 512
DEFAULT_BITRATE = 1e6
#: Errors in a row, of frames that cannot be read or of a bus that is gone, passed over by one `drain`.
_STRANGE_LIMIT = 16

#: Set to 1 it admits a bus without any proof of who sends.
OPEN_BUS = "TROCAR_TEST_OPEN_BUS"

#: What python-can's interfaces take, of those that hand nothing on to a vendor's library.
KEYS = {
    "socketcan": ("channel", "receive_own_messages", "local_loopback", "fd", "ignore_rx_error_frames"),
    "slcan": ("channel", "tty_baudrate", "sleep_after_open", "rtscts", "listen_only", "timeout"),
    "udp_multicast": ("channel", "port", "hop_limit", "receive_own_messages", "fd"),
    "virtual": ("channel", "receive_own_messages", "rx_queue_size", "preserve_timestamps"),
}

# A bus that could not be opened would also complain that nobody closed it.
logging.getLogger("can").setLevel(logging.ERROR)


def open_bus(settings: dict[str, Any], where: str) -> can.BusABC:
    """Return the bus that `settings` (python-can's own: interface, channel, ...) name.

    No filters are set: those of python-can's software kind make a non-blocking `recv` stop early.
    Raises DeviceError: one sentence, whatever python-can or the system says.
    """
    try:
        if settings.get("interface") == "slcan":
            return _open_slcan({name: value for name, value in settings.items() if name != "interface"})
        return can.Bus(**settings)
    except Exception as error:  # plug-ins raise what they like: termios.error is not even an OSError
        raise DeviceError(f"{where}: CAN bus {_name(settings)} cannot be opened: {error}") from None


def _open_slcan(settings: dict[str, Any]) -> can.BusABC:
    try:
        import serial  # noqa: F401
    except ImportError:
        raise ImportError("slcan needs pyserial, which is not installed") from None
    from services.gateway.slcan import SlcanBus  # only here: python-can complains of a missing pyserial by itself

    return share(settings, SlcanBus)


def check_keys(settings: dict[str, Any]) -> None:
    """Refuse a key that the named interface does not know: python-can passes it over, and takes its own value instead.

    Raises ValueError naming the key, or one that is missing with those that are there.
    """
    if "interface" not in settings:
        raise ValueError(f"interface: this key is missing; given: {', '.join(map(str, settings)) or 'none'}")
    known = KEYS.get(str(settings["interface"]))
    if known is None:  # of a vendor's library
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
    if "channel" not in settings:  # without, socketcan hears all buses of the machine
        raise ValueError("channel: this key is missing")


def bitrate(settings: dict[str, Any]) -> float:
    """Return the bit rate of a bus in bit/s: 1 Mbit/s where its settings do not say.

    Raises ValueError if what they say is not a finite number.
    """
    said = settings.get("bitrate", DEFAULT_BITRATE)
    if isinstance(said, bool) or not isinstance(said, int | float) or not math.isfinite(said):
        raise ValueError(f"bitrate must be a number of bit/s, is {said!r}")
    return float(said)


def drain(bus: can.BusABC) -> Iterator[can.Message]:
    """Yield what has arrived, oldest first, without waiting; what is not a CAN frame is passed over.

    A bus that has failed yields nothing: whoever listens judges by the age of what it heard last.
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
