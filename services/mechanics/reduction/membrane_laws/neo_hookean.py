r"""Neo-Hookean membrane that keeps its volume: rubber.

.. math:: w / E = \frac{1}{6} (\mathrm{tr}\, U^2 + (\det U)^{-2} - 3)

with E = 3 mu; the last term is the square of the stretch across the wall. Pulled one way to the stretch l the wall has
the nominal stress E (l - l^-2) / 3: it gives way where it is pulled. w is convex while no area is lost to
nothing: tr U^2 and -log det U are, and what is an exponential of a convex function is.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.reduction.membrane_laws.law import NO_RESPONSE, MembraneLaw, Response, Strain
from trocar.services.mechanics.reduction.membrane_laws.stretch import (
    area_of_stretch,
    function_of,
    plus,
    square_of_stretch,
)

LEAST_AREA = 0.25
"""Of det U; below it the wall resists as by the tangent there, for a linear strain may fall below -1."""
LARGEST_STRAIN = 0.55
"""Up to which the wall's samples are chosen."""


@kernel
def density(strain: Strain, parameters: FloatArray) -> Response:
    """Return energy, stress and tangent over E."""
    area = area_of_stretch(strain)
    at = max(area[0], LEAST_AREA)
    thin, beyond = 1.0 / (at * at), min(area[0] - LEAST_AREA, 0.0)
    slope, curvature = -2.0 * thin / at, 6.0 * thin * thin
    value = thin + beyond * (slope + 0.5 * beyond * curvature)
    across = function_of(value - 1.0, slope + beyond * curvature, curvature, area)
    square = square_of_stretch(strain)
    total = plus((square[0] - 2.0, square[1], square[2]), across, 1.0)
    return plus(NO_RESPONSE, total, 1.0 / 6.0)


LAW = MembraneLaw(density, "gives way as it is pulled: neo-Hookean, as rubber", lambda _: LARGEST_STRAIN**2 / 120.0)
