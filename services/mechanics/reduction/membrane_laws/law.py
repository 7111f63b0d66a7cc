"""What a law of the membrane is: an energy per volume as a function of the strain, with both derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from trocar.services.mechanics.arrays import FloatArray

Strain = tuple[float, float, float]
"""Strain along the wall's axis, round it, and engineering shear."""
Tangent = tuple[float, float, float, float, float, float]
"""Entries 00, 11, 22, 01, 02 and 12 of a symmetric matrix."""
Response = tuple[float, Strain, Tangent]
"""Energy, stress and tangent."""
NO_RESPONSE: Response = (0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
Density = Callable[[Strain, FloatArray], Response]


@dataclass(frozen=True, slots=True)
class MembraneLaw:
    """One row of the table of laws.

    Attributes:
        density: The law: a kernel of a strain and of the parameters, which returns energy, stress and tangent per
            volume, over the modulus E along the wall. It is zero and free of stress without strain. What it is beyond
            its own tangent there is added to the linear wall.
        what: One line for lists.
        parameters: For each parameter, in the order of the density's array, the usual, the least and the largest value.
        is_of_linear_form: Whether it takes the strain y with y . y = e D e / E, D the linear wall's matrix, in place of
            the strain e along and round the wall. The law then has the linear wall's orthotropy.
        unit_form: Of y . y, or e . e, where the law is no longer nearly linear, from the parameters. The wall's samples
            are chosen for loads that would stretch a linear wall to 120 of it.
    """

    density: Density
    what: str
    unit_form: Callable[[FloatArray], float]
    parameters: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    is_of_linear_form: bool = False
