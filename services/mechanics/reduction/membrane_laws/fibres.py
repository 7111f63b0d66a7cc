r"""Two families of fibres in a neo-Hookean wall: Holzapfel, Gasser and Ogden, Journal of Elasticity 61:1 (2000).

.. math:: w = w_{neo-Hooke} + \frac{k_1}{2 k_2} \sum_{+-} (e^{k_2 \langle E_\pm \rangle^2} - 1 - k_2 \langle E_\pm
    \rangle^2), \quad E_\pm = |U n_\pm|^2 - 1

The families n run at an angle to either side of the wall's axis, and bear nothing when they are compressed. What fibres
bear at small strain, the term that is subtracted, is in the linear wall. k1 is a share of the modulus E along the wall.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.reduction.membrane_laws import neo_hookean
from trocar.services.mechanics.reduction.membrane_laws.law import MembraneLaw, Response, Strain
from trocar.services.mechanics.reduction.membrane_laws.stretch import function_of, plus, square_along

MOST_Q = 4.0
"""Of k2 E^2; beyond it a fibre's energy is a straight line in that, as Fung's."""
SHARE, EXPONENT, ANGLE = range(3)

_wall = neo_hookean.density


@kernel
def density(strain: Strain, parameters: FloatArray) -> Response:
    """Return energy, stress and tangent over E."""
    total = _wall(strain, parameters)
    c, s = math.cos(parameters[ANGLE]), math.sin(parameters[ANGLE])
    for side in range(2):
        along = square_along(strain, c, s if side == 0 else -s)
        if along[0] > 1.0:
            total = plus(total, _fibre(along, parameters[EXPONENT]), parameters[SHARE])
    return total


@kernel
def _fibre(along: Response, exponent: float) -> Response:
    """Return the response of a stretched fibre over k1, from that of the square of its stretch."""
    green = along[0] - 1.0
    form = exponent * green * green
    inside = min(form, MOST_Q)
    slope = math.exp(inside) - 1.0
    energy = 0.5 / exponent * (slope - inside + slope * (form - inside))
    curvature = slope + (2.0 * form * (slope + 1.0) if form < MOST_Q else 0.0)
    return function_of(energy, slope * green, curvature, along)


LAW = MembraneLaw(
    density,
    "two families of fibres in rubber: Holzapfel, Gasser and Ogden",
    neo_hookean.LAW.unit_form,
    {"fibre_share": (1.0, 0.0, 100.0), "fibre_exponent": (10.0, 1e-3, 1e4), "fibre_angle_rad": (0.7, 0.0, math.pi / 2)},
)
