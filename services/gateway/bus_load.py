"""How busy a CAN bus is: computed from the frames seen, since no interface of python-can tells."""

from __future__ import annotations

from services.gateway.clock import Clock

_WINDOW_NS = 500_000_000
#: A classic frame with a standard identifier: start, identifier, control, CRC, acknowledge, end and the pause after it,
#: without its data; of these so many are subject to stuffing, a bit after each four in the worst case.
_FIXED_BITS, _STUFFED_BITS, _EXTENDED_BITS = 47, 34, 20


def frame_bits(n_bytes: int, *, is_extended: bool = False) -> int:
    """Return the most bits that a classic CAN frame with so many bytes of data takes on the bus, stuffing included."""
    more = 8 * n_bytes + (_EXTENDED_BITS if is_extended else 0)
    return _FIXED_BITS + more + (_STUFFED_BITS + more - 1) // 4


_BITS = tuple(frame_bits(n) for n in range(9))
_EXTENDED = tuple(frame_bits(n, is_extended=True) for n in range(9))


class BusLoad:
    """Counts frames, and says which share of the bus they take: at most, since stuffing is taken as the worst.

    Args:
        bitrate: Of the bus, bit/s.
        clock: By which the share is told.
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
        """Return the share, 0 to 1, of the last half second or more; asked rarely."""
        now_ns = self._clock.monotonic_ns()
        passed_ns = now_ns - self._since_ns
        if passed_ns >= _WINDOW_NS:
            self._share = self._bits / (self._bitrate * passed_ns * 1e-9)
            self._bits, self._since_ns = 0, now_ns
        return self._share
