r"""Fung's exponential membrane, as what it adds to the linear wall.

Per volume of wall :math:`w = \frac{c}{2} (e^Q - 1)`, Q a quadratic form of the strain (Fung, Fronek and Patitucci,
American Journal of Physiology 237:H620, 1979). With c Q = e D e, D the linear plane-stress matrix, isotropic or not,
and c = E / a, the tangent at rest is that of the linear wall, and one number is left, the exponent a. Pulled one way by
e the wall has the stress E e exp(a e^2). w is a growing convex function of a convex one, so it is convex in the strain.

The strain is the linear one of the modes. A wall that folds has hardly any, while Green's strain of a displacement that
is linear in the modes would count its rotations as stretch.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

MOST_Q = 4.0
"""Beyond it w grows as a straight line in Q: still convex, and 55 times as stiff as at rest."""

Form = TypeVar("Form", float, FloatArray)


def beyond_linear(q_form: Form) -> tuple[Form, Form, Form]:
    """Return exp(Q) - 1 - Q and its first and second derivative, of a number or of each of an array."""
    inside = np.minimum(q_form, MOST_Q)
    slope = np.expm1(inside)
    return slope - inside + slope * (q_form - inside), slope, (slope + 1.0) * (q_form < MOST_Q)


beyond_linear_at = kernel(beyond_linear)
"""The same of a number, for kernels."""
