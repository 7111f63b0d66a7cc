"""A section of a catheter with properties of its own: softer, bent at rest, or steered by a handle."""

from __future__ import annotations

from dataclasses import dataclass

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class CatheterSection:
    """One section. Sections are listed from the tip on; behind the last one the catheter's own values hold.

    A section is as long as it is said to be, whatever the segments: where it ends within one, that has a part of both.
    ``youngs_modulus_pa`` is the catheter's by default. ``rest_curvature_1_m`` is the curvature at rest, and
    ``steering_1_m_rad`` its change per radian of a drive's handle: about m1, about m2 and twist, in the material frame.
    """

    length_m: float
    youngs_modulus_pa: float | None = None
    rest_curvature_1_m: Vector3 = (0.0, 0.0, 0.0)
    steering_1_m_rad: Vector3 = (0.0, 0.0, 0.0)
