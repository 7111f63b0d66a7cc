"""Axes and buttons of input devices: when each was last reported, where it rests, and how far it is pushed.

What an axis means is learned from where it rests: in the middle of its range it is a stick, at an end a trigger. Code
and range do not tell, since makers and kernels differ. Before it was seen at rest it counts as not pushed. Its value
before the first report is no evidence, because the kernel says 0 then.

The page has the same model: ``services/visualization/web/src/hands/axis.js``; both are held to ``test/axis.json``.
"""

from __future__ import annotations

from dataclasses import dataclass

#: What has stood still for so long is at rest.
REST_NS = 250_000_000
#: Time without rest after which a person is told.
PATIENCE_NS = 2_000_000_000
#: A relative axis repeats every 8 to 16 ms while pushed and does not report its release. With the time to the next two
#: polls it falls to zero within 60 ms, which a person takes for at once.
RELEASE_NS = 50_000_000
#: A relative axis without a pause of `RELEASE_NS` since the opening is stuck after this time.
STUCK_NS = 5_000_000_000
#: Deflection that counts as none.
DEAD = 0.12
#: Noise at rest, and distances of places of rest from the middle and from an end, as shares of the range.
_STILL, _MIDDLE, _END = 0.06, 0.2, 0.1
#: An axis that rested at an end, and then is silent for so long so near to its middle, is a stick that was held.
_HELD_NS, _CENTRED = 1_000_000_000, 0.05
#: Time in which the zero follows a drift of the rest, which takes minutes as a device warms; a push begins much faster.
_DRIFT_NS = 1_000_000_000
#: Share of its way from which on a trigger was pressed: beyond noise and dead zone together (`_STILL`, `DEAD`).
_PRESSED = 0.2


@dataclass(slots=True)
class Axis:
    """An absolute axis.

    Attributes:
        low, high: Range.
        raw: Newest value, in the device's unit.
        reported_ns: Time of the newest report; None before the first.
        middle: Value at rest as a stick; None if it is none, or not known yet.
        end: Value at rest as a trigger; None if it is none, or not known yet.
    """

    low: float
    high: float
    raw: float
    reported_ns: int | None = None
    middle: float | None = None
    end: float | None = None
    _began_ns: int | None = None
    _looked_ns: int = 0
    _still_ns: int = 0  # since when it has stayed between these two
    _least: float = 0.0
    _most: float = 0.0
    _was_pressed: bool = False
    _has_returned: bool = False
    _is_first_word: bool = False
    _is_stick: bool = False

    def report(self, raw: float, now_ns: int) -> None:
        """Store a new value."""
        self._is_first_word = self.reported_ns is None and self.raw == 0.0 and raw != 0.0
        self.raw, self.reported_ns = raw, now_ns
        self._least, self._most = min(self._least, raw), max(self._most, raw)
        if self._most - self._least > _STILL * (self.high - self.low):
            self._begin_rest(now_ns)
        if self._is_first_word and self.middle is not None and self._is_near_middle(_MIDDLE):
            self._doubt_middle(raw, now_ns)
        self._was_pressed |= self._pressed > _PRESSED

    def advance(self, now_ns: int) -> None:
        """Learn from all values up to now, after they have been reported."""
        if self._began_ns is None:
            self._began_ns = self._looked_ns = now_ns
            self._begin_rest(now_ns)
        passed_ns, self._looked_ns = now_ns - self._looked_ns, now_ns
        if not self.is_at_rest(now_ns):
            return
        if self.middle is not None:
            self._follow_middle(self.middle, passed_ns)
        elif self.end is not None:
            self._follow_end(self.end, passed_ns, now_ns)
        else:
            self._learn()

    def _doubt_middle(self, raw: float, now_ns: int) -> None:
        """Take the first report for the place of rest, as the kernel's 0 was none; a larger one may be a push."""
        if abs(self.stick()) < DEAD:
            self.middle = raw
        else:
            self.middle, self._is_stick = None, True
            self._begin_rest(now_ns)

    @property
    def came_to_middle(self) -> bool:
        """Whether its first report took it from the kernel's 0 at its end to its middle at once."""
        return self._is_first_word and self.end is not None and self._is_near_middle(_MIDDLE)

    def learn_anew(self, now_ns: int) -> None:
        """Forget where it rests."""
        self.middle = self.end = None
        self._begin_rest(now_ns)

    def is_at_rest(self, now_ns: int) -> bool:
        """Return whether it has stood still for a while; an axis without a range never has."""
        return self.high > self.low and self._began_ns is not None and now_ns - self._still_ns >= REST_NS

    def stick(self) -> float:
        """Return the deflection from the middle, -1 to 1; 0 if it does not rest there."""
        if self.middle is None:
            return 0.0
        way = self.high - self.middle if self.raw > self.middle else self.middle - self.low
        return min(max((self.raw - self.middle) / way, -1.0), 1.0)

    def trigger(self) -> float:
        """Return how far it is pressed from its end, 0 to 1; 0 if it does not rest there.

        One that rests at its high end counts after it was pressed and let go: it could have been held there.
        """
        return self._pressed if self._has_returned or self._share(self.low, self.end) < 0.5 else 0.0

    def problem(self, now_ns: int) -> str:
        """Return what keeps it from being used, empty if nothing does or it is too early to tell."""
        is_early = self._began_ns is None or now_ns - self._began_ns < PATIENCE_NS
        if is_early or self.middle is not None or self.end is not None or not self.high > self.low:
            return ""
        share = f"{100.0 * self._share(self.low, self.raw):.0f} % of its way"
        if self.is_at_rest(now_ns):
            return f"rests at {share}, neither in its middle nor at an end"
        return f"never rests, and is at {share}"

    @property
    def _pressed(self) -> float:
        if self.end is None:
            return 0.0
        far = self.low if self._share(self.low, self.end) > 0.5 else self.high
        return min(max((self.raw - self.end) / (far - self.end), 0.0), 1.0)

    def _begin_rest(self, now_ns: int) -> None:
        self._least = self._most = self.raw
        self._still_ns = now_ns

    def _learn(self) -> None:
        rest = 0.5 * (self._least + self._most)
        share = self._share(self.low, rest)
        self._was_pressed = self._has_returned = False
        if abs(share - 0.5) <= _MIDDLE:
            self.middle = rest
        elif min(share, 1.0 - share) <= _END and not self._is_stick:
            self.end = rest

    def _follow_middle(self, middle: float, passed_ns: int) -> None:
        if abs(self.stick()) < DEAD:
            self.middle = self._followed(middle, passed_ns, 0.5, _MIDDLE)

    def _follow_end(self, end: float, passed_ns: int, now_ns: int) -> None:
        is_high = self._share(self.low, end) > 0.5
        if self._pressed < DEAD:
            self._has_returned |= self._was_pressed
            self.end = self._followed(end, passed_ns, float(is_high), _END)
        elif self._has_returned:
            return
        elif is_high and self._share(self.low, self.raw) <= _END:
            self._learn()  # it was held down when it was opened
        elif now_ns - (self.reported_ns or 0) >= _HELD_NS and self._is_near_middle(_CENTRED):
            self.middle = self.raw

    def _followed(self, rest: float, passed_ns: int, place: float, within: float) -> float:
        rest += (self.raw - rest) * min(1.0, passed_ns / _DRIFT_NS)
        way = self.high - self.low
        return min(max(rest, self.low + (place - within) * way), self.low + (place + within) * way)

    def _is_near_middle(self, within: float) -> bool:
        return abs(self._share(self.low, self.raw) - 0.5) <= within

    def _share(self, low: float, raw: float | None) -> float:
        return 0.0 if raw is None else (raw - low) / (self.high - low)


@dataclass(slots=True)
class RelativeAxis:
    """An axis that reports its deflection again and again while it is pushed, and nothing at rest.

    Attributes:
        full: Value when fully pushed.
        reported_ns: Time of the newest report; None before the first.
    """

    full: float
    reported_ns: int | None = None
    _raw: float = 0.0
    _began_ns: int | None = None
    _has_rested: bool = False

    def report(self, raw: float, now_ns: int) -> None:
        """Store a new value."""
        self._has_rested |= self._is_silent(now_ns)
        self._raw, self.reported_ns = raw, now_ns

    def advance(self, now_ns: int) -> None:
        """Note the time of the opening, and a pause."""
        if self._began_ns is None:
            self._began_ns = now_ns
        self._has_rested |= self._is_silent(now_ns)

    def value(self, now_ns: int) -> float:
        """Return the deflection, -1 to 1; 0 if it is not reported any more."""
        if self.reported_ns is None or now_ns - self.reported_ns >= RELEASE_NS or self.problem(now_ns):
            return 0.0
        return min(max(self._raw / self.full, -1.0), 1.0)

    def problem(self, now_ns: int) -> str:
        """Return what keeps it from being used, or empty."""
        is_early = self._began_ns is None or now_ns - self._began_ns < STUCK_NS
        return "" if is_early or self._has_rested else "never rests"

    def _is_silent(self, now_ns: int) -> bool:
        since_ns = self.reported_ns if self.reported_ns is not None else self._began_ns
        return since_ns is not None and now_ns - since_ns >= RELEASE_NS


@dataclass(slots=True)
class Button:
    """A button, which counts after it has been seen released.

    Attributes:
        is_pressed: Newest report.
        reported_ns: Time of the newest report; None before the first.
    """

    is_pressed: bool = False
    reported_ns: int | None = None
    _was_released: bool = False
    _began_ns: int | None = None

    def report(self, is_pressed: bool, now_ns: int) -> None:
        """Store a new state."""
        self._was_released |= not (self.is_pressed and is_pressed)
        self.is_pressed, self.reported_ns = is_pressed, now_ns

    def advance(self, now_ns: int) -> None:
        """Note the time of the opening."""
        if self._began_ns is None:
            self._began_ns = now_ns
        self._was_released |= not self.is_pressed

    def value(self) -> float:
        """Return 1 while it is pressed, else 0."""
        return float(self.is_pressed and self._was_released)

    def problem(self, now_ns: int) -> str:
        """Return what keeps it from being used, or empty."""
        is_early = self._began_ns is None or now_ns - self._began_ns < PATIENCE_NS
        return "" if is_early or self._was_released else "has been held down since it was opened"
