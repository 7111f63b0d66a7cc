r"""Fung's exponential membrane.

Per volume of wall :math:`w = \frac{c}{2} (e^Q - 1)`, Q a quadratic form of the strain (Fung, Fronek and Patitucci,
American Journal of Physiology 237:H620, 1979). With c Q = e D e, D the linear plane-stress matrix, isotropic or not,
and c = E / a, the tangent at rest is that of the linear wall, and one number is left, the exponent a. Pulled one way by
e the wall has the stress E e exp(a e^2). w is a growing convex function of a convex one, so it is convex in the strain.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel
from trocar.services.mechanics.reduction.membrane_laws.law import MembraneLaw, Response, Strain

MOST_Q = 4.0
"""Beyond it w grows as a straight line in Q: still convex, and 55 times as stiff as at rest."""


@inlined_kernel
def density(strain: Strain, parameters: FloatArray) -> Response:
    """Return energy, stress and tangent over E; the strain is that of the linear wall's energy, Q is a y . y."""
    x, y, z = strain
    exponent = parameters[0]
    form = exponent * (x * x + y * y + z * z)
    slope = math.exp(min(form, MOST_Q))
    energy = 0.5 / exponent * (slope - 1.0 + slope * (form - min(form, MOST_Q)))
    turned = 2.0 * exponent * slope if form < MOST_Q else 0.0
    tangent = (
        slope + turned * x * x,
        slope + turned * y * y,
        slope + turned * z * z,
        turned * x * y,
        turned * x * z,
        turned * y * z,
    )
    return energy, (slope * x, slope * y, slope * z), tangent


LAW = MembraneLaw(
    density,
    "stiffens exponentially, as the linear wall is orthotropic: Fung",
    lambda parameters: float(1.0 / parameters[0]),
    {"exponent": (20.0, 1e-3, 1e4)},
    is_of_linear_form=True,
)
