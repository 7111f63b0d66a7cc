"""A cystic duct by its anatomy: what a scene says of it, and what is drawn within published ranges by a seed."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from trocar.services.messages.sourced_value import SourcedValue, assumed_value

Course = Literal["straight", "s", "alpha"]

COMMON_VEIN = "thecommonvein.net, gallbladder, ducts"
CAO = "Cao et al., BMC Gastroenterology 19:139 (2019), doi 10.1186/s12876-019-1053-6, 226 patients"
PINA = "Pina et al., The Surgery Journal 1:e23 (2015), doi 10.1055/s-0035-1567879, 46 cadavers"
SPIRAL = 0.5
"""Share of the length, towards the gallbladder, that has folds (pars spiralis); the rest is smooth (pars glabra)."""
_CLOSEST_M = 2e-3
"""Assumption: folds that are the wall laid double, and the lumen between them, need so much each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CysticDuctScene:
    """A cystic duct from its cut near the gallbladder, the mouth, to the common duct, whose two ends are held.

    What is not said is drawn by the ``seed`` within the ranges of `RANGES`; without a seed it is their usual value.
    Widths are those of the lumen. ``course`` is straight, "s" or "alpha", which makes a loop. ``turn_rad`` is how far
    the direction of an S swings. ``take_off_rad`` is the angle between the cystic duct and the common duct above their
    junction. ``folds`` is the number of crescents (valves of Heister) in the half towards the gallbladder, 0 for none;
    ``fold_height`` their share of the lumen's radius there, ``fold_side_rad`` on which side of the lumen the first
    lies. Folds are the wall's own: they are thrown into it.
    """

    seed: int | None = None
    course: Course | None = None
    length_m: float | None = None
    width_m: float | None = None
    end_width_m: float | None = None
    turn_rad: float | None = None
    take_off_rad: float | None = None
    common_width_m: float | None = None
    common_length_m: float = 30e-3
    folds: int | None = None
    fold_height: float | None = None
    fold_side_rad: float | None = None


RANGES: dict[str, SourcedValue] = {
    "length_m": SourcedValue(30e-3, 20e-3, 40e-3, f"20 to 40 mm, up to 100: {COMMON_VEIN}"),
    "width_m": assumed_value(
        3.5e-3, 2.4e-3, 5e-3, f"1 to 5 mm: {COMMON_VEIN}; below 2.4 mm, left out here, a 5 Fr catheter has no play"
    ),
    "end_width_m": assumed_value(3.5e-3, 2.4e-3, 5e-3, f"as width_m: {COMMON_VEIN}"),
    "turn_rad": assumed_value(1.0, 0.6, 1.3, "assumption; no figure found"),
    "take_off_rad": assumed_value(0.7, 0.35, 1.2, "assumption; a sharp angle is a cause of failure, no figure found"),
    "common_width_m": assumed_value(6e-3, 5e-3, 8e-3, "assumption; wider than the cystic duct"),
    "folds": SourcedValue(6.0, 4.0, 10.0, f"4 to 10 in the half towards the gallbladder: {COMMON_VEIN}"),
    "fold_height": assumed_value(
        0.7,
        0.5,
        0.85,
        "assumption; no figure found. Below 0.52 a 5 Fr catheter passes the usual width without touching a fold, and "
        f"folds are known to stop it: {CAO}; {PINA}",
    ),
    "fold_side_rad": assumed_value(0.0, -3.1416, 3.1416, "assumption: any side"),
}
COURSES: dict[Course, float] = {"straight": 0.75, "s": 0.15, "alpha": 0.10}
"""Shares of the courses: 85 % run in a line with variants S and alpha (Cao et al.), whose shares are assumptions."""
ALPHA_LENGTH = assumed_value(
    50e-3, 42e-3, 60e-3, f"assumption; a loop needs length, ducts are up to 100 mm: {COMMON_VEIN}"
)


def drawn_cystic_duct(cystic: CysticDuctScene) -> CysticDuctScene:
    """Return a duct of which everything is said: what a scene leaves open is drawn, or the usual value."""
    random = None if cystic.seed is None else np.random.default_rng(cystic.seed)
    course = cystic.course or _course(random)
    ranges = RANGES | ({"length_m": ALPHA_LENGTH} if course == "alpha" else {})
    drawn: dict[str, Any] = {name: _value(quantity, random) for name, quantity in ranges.items()}
    said = {field.name: getattr(cystic, field.name) for field in fields(cystic)}
    drawn["folds"] = min(round(drawn["folds"]), max(most_folds(said["length_m"] or drawn["length_m"]), 0))
    kept = {name: value for name, value in drawn.items() if said[name] is None}
    return replace(cystic, course=course, **kept)


def most_folds(length_m: float) -> int:
    """Return how many folds have room in a duct of this length."""
    return int(SPIRAL * length_m / _CLOSEST_M + 1e-6)


def _course(random: np.random.Generator | None) -> Course:
    """Return a course; without a generator the usual one."""
    if random is None:
        return "straight"
    share, total = float(random.random()), 0.0
    for course, part in COURSES.items():
        total += part
        if share < total:
            return course
    return "alpha"


def _value(quantity: SourcedValue, random: np.random.Generator | None) -> float:
    """Return a value within a range, evenly drawn; a value is drawn of each, so that what is said changes no other."""
    return quantity.value if random is None else float(random.uniform(quantity.low, quantity.high))
