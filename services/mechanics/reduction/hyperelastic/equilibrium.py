"""Rest shapes of a stiffening wall under loads on its modes."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.hyperelastic.fung_membrane import beyond_linear

RELATIVE = 1e-6
"""Of the load, by what each mode stores of it: what is left unbalanced."""


def rest_shape(strain: FloatArray, energy_j: FloatArray, omega_rad_s: FloatArray, force: FloatArray) -> FloatArray:
    r"""Return the modal coordinates (r,) at rest under a modal force (r,).

    They minimise :math:`\frac12 |\omega q|^2 + E(q) - f q`, a convex function, by Newton's method in a trust region.
    ``strain`` (3 k, r) and ``energy_j`` (k,) as in `StretchSamples`.
    """
    # Imported where a wall is trained: it is a good part of what a process imports.
    from scipy.optimize import minimize

    rows, load = strain / omega_rad_s, force / omega_rad_s

    def value(y: FloatArray) -> tuple[float, FloatArray]:
        at = (rows @ y).reshape(-1, 3)
        beyond, slope, _ = beyond_linear(np.sum(at**2, axis=1))
        stress = (2.0 * energy_j * slope)[:, None] * at
        return 0.5 * y @ y + energy_j @ beyond - load @ y, y + stress.ravel() @ rows - load

    def tangent(y: FloatArray) -> FloatArray:
        at = (rows @ y).reshape(-1, 3)
        _, slope, curvature = beyond_linear(np.sum(at**2, axis=1))
        along = np.einsum("ka,kar->kr", at, rows.reshape(-1, 3, y.size))
        stiff: FloatArray = np.eye(y.size) + rows.T @ (np.repeat(2.0 * energy_j * slope, 3)[:, None] * rows)
        stiff += along.T @ ((4.0 * energy_j * curvature)[:, None] * along)
        return stiff

    most = RELATIVE * float(np.linalg.norm(load))
    found = minimize(value, np.zeros(force.size), method="trust-exact", jac=True, hess=tangent, options={"gtol": most})
    q: FloatArray = found.x / omega_rad_s
    return q
