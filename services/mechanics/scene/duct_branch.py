"""A branch of a duct: a tube that leaves the trunk, or another branch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class DuctBranch:
    """One branch; the trunk is the duct itself, seen from its mouth.

    It leaves ``parent`` at ``at_m`` from the parent's near end, by default at its far end, then no opening. Its axis
    starts at ``angle_rad`` to the parent's, towards the side ``azimuth_rad``: 0 is the side to which a positive
    curvature bends the parent, +y at the far end of the trunk. Its own curvature bends it further aside; ``taper`` is
    the fraction by which its radius falls along it. The far ``end`` is a held or free opening, or a blind end.
    """

    name: str
    parent: str = "trunk"
    at_m: float | None = None
    angle_rad: float = 0.6
    azimuth_rad: float = 0.0
    radius_m: float = 3e-3
    length_m: float = 25e-3
    taper: float = 0.0
    curvature_1_m: float = 0.0
    end: Literal["held", "free", "blind"] = "held"
