"""Rest shapes of a stiffening wall under loads on its modes."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear

RELATIVE = 1e-6
"""Of the load, by what each mode stores of it: what is left unbalanced."""


def rest_shape(
    strain: FloatArray, energy_j: FloatArray, law: BeyondLinear, omega_rad_s: FloatArray, force: FloatArray
) -> FloatArray:
    r"""Return the modal coordinates (r,) at rest under a modal force (r,).

    They minimise :math:`\frac12 |\omega q|^2 + E(q) - f q`, of a convex law a convex function, by Newton's method in a
    trust region. ``strain`` (3 k, r), ``energy_j`` (k,) and ``law`` as in `StretchSamples`.
    """
    # Imported where a wall is trained: it is a good part of what a process imports.
    from scipy.optimize import minimize

    rows, load = strain / omega_rad_s, force / omega_rad_s

    def value(y: FloatArray) -> tuple[float, FloatArray]:
        beyond, stress, _ = law.respond((rows @ y).reshape(-1, 3))
        pull = (energy_j[:, None] * stress).ravel()
        return float(0.5 * y @ y + energy_j @ beyond - load @ y), y + pull @ rows - load

    def tangent(y: FloatArray) -> FloatArray:
        _, _, stiff = law.respond((rows @ y).reshape(-1, 3))
        pulled = (energy_j[:, None, None] * stiff) @ rows.reshape(-1, 3, y.size)
        tangent: FloatArray = np.eye(y.size) + rows.T @ pulled.reshape(-1, y.size)
        return tangent

    most = RELATIVE * float(np.linalg.norm(load))
    found = minimize(value, np.zeros(force.size), method="trust-exact", jac=True, hess=tangent, options={"gtol": most})
    q: FloatArray = found.x / omega_rad_s
    return q
