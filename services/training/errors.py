"""Errors E1 to E14: one rule for each kind of evidence, and the detector of a rule."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import msgspec

from trocar.services.training.procedure import Procedure
from trocar.services.training.scenario import ErrorCode, Phase, Scenario
from trocar.services.training.situation import Situation

Severity = Literal["critical", "consequential", "inconsequential", "coaching"]
Evidence = Callable[[Situation, Procedure], float | None]
_MOVING_M_S = 5e-3  # a tremor of 0.1 mm at 8 Hz has as much at most: 2 pi f a
_SECURED = ("P5", "P6")
RELEASE_S = 0.05
"""How long the evidence must be within its limit for an error to end."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule: an error is `evidence` above its limit, or below, for longer than `for_s`.

    None is no evidence, as the situation that the rule is about does not occur.
    """

    code: ErrorCode
    name: str
    limit: str
    severity: Severity
    evidence: Evidence
    for_s: float = 0.0
    below: bool = False


ERRORS: dict[ErrorCode, tuple[str, str]] = {
    "E1": ("excess traction", "Hold the duct with less force: a skeletonised duct tears easily."),
    "E2": ("ductotomy enlarged", "Keep catheter and jaws off the rim: come in along the axis of the duct."),
    "E3": ("tip misses the opening", "Look where the tip is before pushing, and aim once: turn it to the entry angle."),
    "E4": ("wall perforated", "Stop as soon as the tip meets resistance, draw back a little and turn."),
    "E5": ("push against resistance", "Do not push what does not advance: hold nearer to the mouth, or turn."),
    "E6": ("secured at a wrong depth", "Secure between the first and the second marker."),
    "E7": ("catheter slipped out", "Keep hold of the catheter until it is secured."),
    "E8": ("catheter crushed or kinked", "Close the jaws on the catheter only so far that it does not slide."),
    "E9": ("crimped or loose when secured", "Close the clip until it does not leak, and no further."),
    "E10": ("air or leak", "Flush the line outside before it goes in, and secure before flushing."),
    "E11": ("wrong direction", "Lead the tip away from the gallbladder, along the duct."),
    "E12": ("instrument unseen or colliding", "Keep both instruments in view and apart."),
    "E13": (
        "catheter dropped or regrasped",
        "Take the catheter where it can stay held, and move your hand less often.",
    ),
    "E14": ("counter-traction lost", "Steady the duct with the other hand while the catheter goes in."),
}
"""Name of each error, and advice for practice."""


def _most(values: Iterable[float]) -> float | None:
    return max(values, default=None)


def _grasp_of_duct(s: Situation, p: Procedure) -> float | None:
    """Return the squeeze of the duct, except by the clip, which has limits of its own."""
    return s.squeeze_n[0] - (s.clip_n if p.phase in (*_SECURED, "P7") else 0.0)


def _stalled_push(s: Situation, p: Procedure) -> float | None:
    return s.push_n if s.advance_m_s < p.scenario.limit("stalled_m_s") and p.phase in ("P3", "P4") else None


def _off_view(s: Situation, _: Procedure) -> float | None:
    """Return the largest angle of a moving instrument from the view's axis."""
    return _most(angle for hand, angle in zip(s.hands, s.view_angle_rad, strict=False) if hand.speed_m_s > _MOVING_M_S)


def _blind_load(s: Situation, p: Procedure) -> float | None:
    """Return the largest load on an instrument out of view."""
    limit_rad = p.scenario.limit("view_angle_rad")
    return _most(hand.load_n for hand, angle in zip(s.hands, s.view_angle_rad, strict=False) if angle > limit_rad)


RULES: tuple[Rule, ...] = (
    Rule("E1", "traction", "tool_duct_force_n", "consequential",
         lambda s, p: _most([hand.load_n for hand in s.hands if hand.grips_duct]), 0.1),
    Rule("E1", "grasp of the duct", "grasp_force_n", "consequential", _grasp_of_duct, 0.1),
    Rule("E2", "load on the rim", "rim_load_n", "consequential", lambda s, p: s.rim_n, 0.1),
    Rule("E2", "area of the opening", "rim_opening_ratio", "consequential", lambda s, p: s.rim_opening, 0.1),
    Rule("E3", "push beside the opening", "probe_force_n", "inconsequential",
         lambda s, p: s.tip_n if s.inserted_m == 0.0 else None, 0.2),
    Rule("E3", "withdrawal before a retry", "withdrawal_m", "inconsequential", lambda s, p: p.withdrawal_m),
    Rule("E4", "force at the tip", "tip_force_n", "critical", lambda s, p: s.tip_n, 0.02),
    Rule("E4", "depth in the wall", "penetration_m", "critical",
         lambda s, p: s.penetration_m if s.tissue_n[2] > 0.0 else None, 0.02),
    Rule("E4", "length left the lumen at once", "jump_m", "critical", lambda s, p: p.jump_m),
    Rule("E5", "push without advance", "push_force_n", "consequential", _stalled_push, 0.2),
    Rule("E5", "arc over chord of the free catheter", "buckling_ratio", "consequential",
         lambda s, p: s.arc_over_chord if p.phase in ("P3", "P4") else None, 0.1),
    Rule("E6", "secured too deep", "depth_max_m", "consequential", lambda s, p: p.secured_m),
    Rule("E6", "secured too shallow", "depth_min_m", "consequential", lambda s, p: p.secured_m, below=True),
    Rule("E7", "length left inside", "slipped_out_m", "inconsequential",
         lambda s, p: s.inserted_m if p.deepest_m >= p.scenario.limit("depth_min_m") else None, below=True),
    Rule("E8", "squeeze of the catheter", "crush_force_n", "consequential", lambda s, p: s.squeeze_n[1], 0.1),
    Rule("E8", "radius of the sharpest bend", "bend_radius_m", "consequential",
         lambda s, p: s.bend_radius_m, 0.1, below=True),
    Rule("E9", "clip crimps", "clip_max_n", "consequential",
         lambda s, p: s.clip_n if p.phase in _SECURED else None, 1.0),
    Rule("E9", "clip is loose", "clip_min_n", "consequential",
         lambda s, p: s.clip_n if p.phase in _SECURED else None, 1.0, below=True),
    Rule("E10", "air flushed in", "air_s", "critical", lambda s, p: p.unprimed_s),
    Rule("E10", "leak while flushing", "clip_min_n", "critical",
         lambda s, p: s.clip_n if s.flushing and s.inserted_m > 0.0 else None, 0.1, below=True),
    Rule("E11", "direction of the tip along the duct", "direction_cosine", "consequential",
         lambda s, p: s.direction_cosine if s.inserted_m < 0.01 else None, 0.1, below=True),
    Rule("E12", "angle off the view", "view_angle_rad", "inconsequential", _off_view, 1.0),
    Rule("E12", "distance of the shafts", "shaft_distance_m", "inconsequential",
         lambda s, p: s.shafts_apart_m, 0.05, below=True),
    Rule("E12", "force out of view", "blind_force_n", "inconsequential", _blind_load, 0.1),
    Rule("E13", "time not held", "dropped_s", "inconsequential",
         lambda s, p: p.unheld_s if p.phase in ("P2", "P3") else None),
    Rule("E13", "slide in closed jaws", "hold_slip_m", "inconsequential", lambda s, p: p.slide_m),
    Rule("E13", "lost from closed jaws", "losses", "inconsequential", lambda s, p: p.lost),
    Rule("E13", "regrasps", "regrasps", "inconsequential", lambda s, p: float(p.regrasps)),
    Rule("E14", "counter-traction", "counter_traction_n", "coaching", lambda s, p: p.counter_n, 1.0, below=True),
)  # fmt: skip


class ErrorEvent(msgspec.Struct, frozen=True, kw_only=True):
    """An error from `begin_s` to `end_s` of the attempt, with its worst value, and the limit in the same unit."""

    code: ErrorCode
    evidence: str
    severity: Severity
    phase: Phase
    begin_s: float
    end_s: float
    worst: float
    limit: float
    unit: str


class ErrorLog:
    """Applies all rules to situations."""

    def __init__(self, scenario: Scenario) -> None:
        self._detectors = [_Detector(rule, scenario.limit(rule.limit)) for rule in RULES]

    def take_situation(self, s: Situation, p: Procedure) -> None:
        """Apply the rules to a situation already processed by the procedure."""
        for detector in self._detectors:
            detector.take_evidence(detector.rule.evidence(s, p), p)

    @property
    def events(self) -> list[ErrorEvent]:
        """The errors so far, by their start; a present one ends now."""
        found = [event for detector in self._detectors for event in detector.events()]
        return sorted(found, key=lambda event: event.begin_s)


class _Detector:
    """Detects the errors of one rule, with hysteresis in time."""

    def __init__(self, rule: Rule, limit: float) -> None:
        self.rule = rule
        self._limit = limit
        self._ended: list[ErrorEvent] = []
        self._begin_s: float | None = None
        self._last_s = self._worst = 0.0
        self._phase: Phase = "P0"

    def take_evidence(self, value: float | None, p: Procedure) -> None:
        is_at_fault = value is not None and (value < self._limit if self.rule.below else value > self._limit)
        if is_at_fault:
            assert value is not None
            if self._begin_s is None:
                self._begin_s, self._phase, self._worst = p.time_s, p.phase, value
            self._last_s = p.time_s
            self._worst = min(self._worst, value) if self.rule.below else max(self._worst, value)
        elif self._begin_s is not None and (p.time_s - self._last_s > RELEASE_S or not self._is_error):
            self._ended = self.events()
            self._begin_s = None

    @property
    def _is_error(self) -> bool:
        return self._begin_s is not None and self._last_s - self._begin_s >= self.rule.for_s - 1e-9

    def events(self) -> list[ErrorEvent]:
        """Return the errors of this rule, including a present one."""
        if self._begin_s is None or not self._is_error:
            return self._ended
        rule = self.rule
        event = ErrorEvent(
            code=rule.code, evidence=rule.name, severity=rule.severity, phase=self._phase, begin_s=self._begin_s,
            end_s=self._last_s, worst=self._worst, limit=self._limit, unit=unit_of(rule.limit),
        )  # fmt: skip
        return [*self._ended, event]


def unit_of(limit: str) -> str:
    """Return the unit at the end of a limit's name, empty for a pure number."""
    return next((unit for end, unit in _UNITS.items() if limit.endswith(end)), "")


_UNITS = {"_m_s": "m/s", "_rad": "rad", "_n": "N", "_m": "m", "_s": "s"}
