"""The criteria of the suite, as data: what is measured of a run, and what it must not exceed."""

from __future__ import annotations

import math
from dataclasses import dataclass

Figures = dict[str, float]
"""What a run showed: by criterion, as many as apply to it. A figure that is not a number fails."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """One number of a run, and the largest value that passes.

    Attributes:
        what: str. What is measured and how, for the table's reader.
        unit: str. "" for ratios and counts.
        limit: float
    """

    what: str
    unit: str
    limit: float


HAND_SPEED_M_S = 0.5
"""Up to here a motion counts as one of a hand, with the small limit of penetration."""
REST_SPEED_M_S = 1e-3
"""A scene whose catheter and wall are slower is at rest."""
REST_S = 2.0
"""So long may it take to come to rest, unless what is there is damped too little for that."""

CRITERIA: dict[str, Criterion] = {
    "raised": Criterion("ticks that ended in an exception", "", 0),
    "not_finite": Criterion("ticks after which a state or a force is not finite", "", 0),
    "gain": Criterion(
        "energy that came out without a hand: largest fall of (input - stored) below its highest value so far, "
        "relative to the largest energy put in or stored",
        "",
        0.01,
    ),
    "imbalance": Criterion(
        "input - stored - all dissipation, each computed from its own quantity, relative to the same energy", "", 0.01
    ),
    "speed": Criterion(
        "speed of a particle or of the wall, relative to what can cause it: twice the hand's speed, a free fall over "
        "the catheter's length, and the largest strain so far times the speed of sound",
        "",
        1.0,
    ),
    "stretch": Criterion(
        "strain of a segment beyond that of the largest force felt and of the hand's speed over the speed of sound",
        "",
        0.05,
    ),
    "penetration_hand": Criterion(
        "overlap of catheter, wall and stones at the end of a tick, by brute force on the drawn shapes; hands at most "
        "at 0.5 m/s, without jumps",
        "m",
        0.1e-3,
    ),
    "penetration_any": Criterion(
        "the same for any input, relative to the thickness of the wall or the radius of the catheter",
        "",
        0.5,
    ),
    "tool_penetration_hand": Criterion(
        "the same of a tool with wall or catheter, a wall between jaws counting as thick as there is room; hands at "
        "most at 0.5 m/s, without jumps",
        "m",
        0.1e-3,
    ),
    "tool_penetration_any": Criterion("the same for any input, relative to the same thickness", "", 0.5),
    "tool_crossings": Criterion(
        "shafts and jaws whose axis goes through the wall's mid-surface at the same time, counted likewise", "", 0
    ),
    "crossings": Criterion(
        "segments of the catheter's centreline that cross the wall's mid-surface, counted without collision detection",
        "",
        0,
    ),
    "force_step": Criterion(
        "change of the contact force on a tool per millisecond, from tick to tick, except a fall towards zero; beyond "
        "the limit the tick is repeated from the same state in sixteenths, and the figure is the distance from the "
        "forces that these go through until a tick later",
        "N",
        0.3,
    ),
    "force_fall": Criterion("that fall: told, not judged", "N", math.inf),
    "snaps": Criterion("changes of a force that finer steps have been asked about: told, not judged", "", math.inf),
    "withheld": Criterion("share of the simulated time that did not happen because no motion was sound", "", 0.05),
    "hand_lead": Criterion(
        "distance of a hand from its tool beyond what the spring and the damper between them explain by the force that "
        "the tool bears; hands at most at 0.5 m/s, without jumps",
        "m",
        3e-3,
    ),
    "tick_median": Criterion("processor time of a tick, the median of a run: told, not judged", "s", math.inf),
    "tick_longest": Criterion("the longest: told, not judged", "s", math.inf),
    "ticks_above_5_ms": Criterion("share of ticks that took longer: told, not judged", "", math.inf),
    "ticks_above_20_ms": Criterion("share of ticks that took longer: told, not judged", "", math.inf),
    "felt_error": Criterion("distance of the reported force from the sum of the contact forces", "N", 1e-9),
    "rest": Criterion("time from the hands' leaving until nothing moves faster than 1 mm/s", "s", REST_S),
    "rest_damped": Criterion(
        "the same, relative to the time in which its own damping slows the motion from v to 1 mm/s, if that exceeds 2 "
        "s; v is the speed within the first 0.1 s, at least 1 m/s; the time is ln(v / 1 mm/s) / (zeta omega) for the "
        "wall's slowest mode, ln(v / 1 mm/s) / r for a catheter whose slowest mode falls by the rate r under its drag, "
        "and that of the creep of a wall that relaxes and was held a duct's length away",
        "",
        1.0,
    ),
    "shape": Criterion("distance from the rest shape of an undisturbed run, without friction", "m", 0.05e-3),
    "creep": Criterion("motion of a stuck contact, scaled to a minute", "m", 1e-6),
    "relaxation": Criterion("lost share of a held force, scaled to a minute", "", 0.01),
    "law": Criterion("relative error of a force against its law", "", 0.05),
    "leaks": Criterion("runs that change in a bit if another case has run before them", "", 0),
    "healed": Criterion("ticks that began in a state that is physically impossible, and was put back", "", 0),
    "healed_by_design": Criterion(
        "the same in families whose input no state can be expected to bear: told, not judged", "", math.inf
    ),
    "dropped": Criterion("pairs, contacts and holds without room", "", 0),
    "dropped_by_design": Criterion("the same where `healed_by_design` is", "", math.inf),
    "residual": Criterion("relative residual of a static solution", "", 1e-8),
    "reference": Criterion("relative error against a closed form or a converged solution", "", 0.05),
    "drift": Criterion("energy above the first one, relative, in an undamped run without contact", "", 0.01),
    "theory": Criterion("predictions of theory (stable here, unstable there) that did not come true", "", 0),
    "wrong_answers": Criterion("inputs that are neither answered rightly nor refused in a sentence", "", 0),
}


def failures(figures: Figures) -> list[str]:
    """Return the criteria that the figures do not meet, in the order of the table."""
    return [name for name in CRITERIA if name in figures and not figures[name] <= CRITERIA[name].limit]


def load_of(name: str, value: float) -> float:
    """Return how near a figure is to its limit: above 1 it fails; a count that should be 0 is 0 or infinite."""
    limit = CRITERIA[name].limit
    if math.isinf(limit):
        return 0.0
    if math.isnan(value):
        return math.inf
    if limit == 0.0:
        return 0.0 if value <= 0.0 else math.inf
    return value / limit


def shown(name: str, value: float) -> str:
    """A figure with its unit, in a size that is read easily."""
    unit = CRITERIA[name].unit
    if not math.isfinite(value):
        return "never" if name == "rest" else "-"
    if unit == "m" and value != 0.0:
        return f"{1e3 * value:.3g} mm" if abs(value) >= 1e-5 else f"{1e6 * value:.3g} um"
    return f"{value:.3g} {unit}".strip()
