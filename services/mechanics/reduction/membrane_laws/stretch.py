r"""Invariants of the stretch, for laws that are written with it.

The linear strain e of the modes is taken as Biot's: the stretch is U = 1 + e, so a wall that is pulled to 1.3 of its
length, without turning, has e = 0.3. Both invariants are exact of it, and so are their derivatives by the strain.
"""

from __future__ import annotations

from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.reduction.membrane_laws.law import Response, Strain


@kernel
def square_of_stretch(strain: Strain) -> Response:
    """Return tr U^2 and its derivatives."""
    a, b, shear = 1.0 + strain[0], 1.0 + strain[1], strain[2]
    return a * a + b * b + 0.5 * shear * shear, (2.0 * a, 2.0 * b, shear), (2.0, 2.0, 1.0, 0.0, 0.0, 0.0)


@kernel
def area_of_stretch(strain: Strain) -> Response:
    """Return det U, the area over that at rest, and its derivatives."""
    a, b, shear = 1.0 + strain[0], 1.0 + strain[1], strain[2]
    return a * b - 0.25 * shear * shear, (b, a, -0.5 * shear), (0.0, 0.0, -0.5, 1.0, 0.0, 0.0)


@kernel
def square_along(strain: Strain, c: float, s: float) -> Response:
    """Return |U n|^2, the square of the stretch of a line along n = (c, s), and its derivatives."""
    x = (1.0 + strain[0]) * c + 0.5 * strain[2] * s
    y = 0.5 * strain[2] * c + (1.0 + strain[1]) * s
    first = 2.0 * x * c, 2.0 * y * s, x * s + y * c
    return x * x + y * y, first, (2.0 * c * c, 2.0 * s * s, 0.5 * (c * c + s * s), 0.0, c * s, c * s)


@kernel
def function_of(value: float, slope: float, curvature: float, inner: Response) -> Response:
    """Return the response of f(w), from f, f' and f'' at w, and the response of w."""
    _, (a, b, c), (aa, bb, cc, ab, ac, bc) = inner
    tangent = (
        slope * aa + curvature * a * a,
        slope * bb + curvature * b * b,
        slope * cc + curvature * c * c,
        slope * ab + curvature * a * b,
        slope * ac + curvature * a * c,
        slope * bc + curvature * b * c,
    )
    return value, (slope * a, slope * b, slope * c), tangent


@kernel
def plus(one: Response, other: Response, factor: float) -> Response:
    """Return one + factor other."""
    stress, more, tangent, stiff = one[1], other[1], one[2], other[2]
    return (
        one[0] + factor * other[0],
        (stress[0] + factor * more[0], stress[1] + factor * more[1], stress[2] + factor * more[2]),
        (
            tangent[0] + factor * stiff[0],
            tangent[1] + factor * stiff[1],
            tangent[2] + factor * stiff[2],
            tangent[3] + factor * stiff[3],
            tangent[4] + factor * stiff[4],
            tangent[5] + factor * stiff[5],
        ),
    )
