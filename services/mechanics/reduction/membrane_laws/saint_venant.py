r"""Saint-Venant and Kirchhoff's membrane: linear between Green's strain and its stress.

:math:`w = \frac{1}{2} G : D : G` with Green's strain :math:`G = (U^2 - 1) / 2` and the isotropic plane-stress matrix D.
Pulled one way by e the wall has the nominal stress E G (1 + e). It is convex unless it is compressed by more than
1 - 1 / sqrt(3) = 0.42.
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

LARGEST_STRAIN = 0.4
"""Up to which the wall's samples are chosen."""


@kernel
def density(strain: Strain, parameters: FloatArray) -> Response:
    r"""Return energy, stress and tangent over E.

    By the invariants I = tr U^2 and J = det U, with tr G = I / 2 - 1 and det G = (J^2 - I + 1) / 4:
    w = ((tr G)^2 / 2 - (1 - nu) det G) / (1 - nu^2).
    """
    nu = parameters[0]
    square, area = square_of_stretch(strain), area_of_stretch(strain)
    trace = 0.5 * square[0] - 1.0
    total = function_of(0.5 * trace * trace, 0.5 * trace, 0.25, square)
    lost = 0.25 * (1.0 - nu)
    total = plus(total, (square[0] - 2.0, square[1], square[2]), lost)
    J = area[0]
    total = plus(total, function_of(J * J - 1.0, 2.0 * J, 2.0, area), -lost)
    return plus(NO_RESPONSE, total, 1.0 / (1.0 - nu * nu))


LAW = MembraneLaw(
    density,
    "linear in Green's strain: Saint-Venant and Kirchhoff",
    lambda _: LARGEST_STRAIN**2 / 120.0,
    {"poisson_ratio": (0.45, 0.0, 0.5)},
)
