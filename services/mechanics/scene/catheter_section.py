"""A piece of a catheter that differs from the rest: softer, bent at rest, or steered by a handle."""

from __future__ import annotations

from dataclasses import dataclass

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class CatheterSection:
    """One section of the catheter, listed from the tip on; the rest has the catheter's own properties.

    ``youngs_modulus_pa`` is the catheter's unless given. ``rest_curvature_1_m`` is how it is bent at rest, and
    ``steering_1_m_rad`` what each radian of a drive's handle adds: about m1, about m2 and twist, in the material frame.
    """

    length_m: float
    youngs_modulus_pa: float | None = None
    rest_curvature_1_m: Vector3 = (0.0, 0.0, 0.0)
    steering_1_m_rad: Vector3 = (0.0, 0.0, 0.0)
