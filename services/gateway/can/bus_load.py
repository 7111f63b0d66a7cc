"""Load of a CAN bus, computed from the frames seen, since no interface of python-can reports it."""

from __future__ import annotations

from trocar.services.gateway.devices.clock import Clock

_WINDOW_NS = 500_000_000  # five heartbeats of each drive, the slowest of its frames, so that a window has all kinds
#: Bits of a classic frame with a standard identifier, from start to the pause after it, without data; bits of these
#: that are subject to stuffing (at worst one after each four); and additional bits of an extended identifier.
_FIXED_BITS, _STUFFED_BITS, _EXTENDED_BITS = 47, 34, 20


def frame_bits(n_bytes: int, *, is_extended: bool = False) -> int:
    """Return the most bits of a classic CAN frame with `n_bytes` of data on the bus, stuffing included."""
    more = 8 * n_bytes + (_EXTENDED_BITS if is_extended else 0)
    return _FIXED_BITS + more + (_STUFFED_BITS + more - 1) // 4


_BITS = tuple(frame_bits(n) for n in range(9))
_EXTENDED = tuple(frame_bits(n, is_extended=True) for n in range(9))


class BusLoad:
    """Counts frames, and computes an upper bound of the bus' load, with worst-case stuffing.

    Args:
        bitrate: Of the bus, bit/s.
        clock: Clock for the averaging window.
    """

    def __init__(self, bitrate: float, clock: Clock) -> None:
        self._bitrate = bitrate
        self._clock = clock
        self._bits = 0
        self._since_ns = clock.monotonic_ns()
        self._share = 0.0

    def count(self, n_bytes: int, *, is_extended: bool = False) -> None:
        """Count a frame, sent or received."""
        self._bits += (_EXTENDED if is_extended else _BITS)[min(n_bytes, 8)]

    def share(self) -> float:
        """Return the load, 0 to 1, over the last half second or more; for rare calls."""
        now_ns = self._clock.monotonic_ns()
        passed_ns = now_ns - self._since_ns
        if passed_ns >= _WINDOW_NS:
            self._share = self._bits / (self._bitrate * passed_ns * 1e-9)
            self._bits, self._since_ns = 0, now_ns
        return self._share
