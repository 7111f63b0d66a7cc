"""Relaxation of the softening force, so that a viscoelastic wall relaxes by one law as a whole.

Of the force N(q) = K q - F(q) of a wall that softens by F, terms of a Prony series take back sum_k g_k h_k, h_k' =
(N - h_k) / tau_k (quasi-linear viscoelasticity: Y. C. Fung, Biomechanics, 1993, 7.6). What lags of K q the modes'
relaxation has, h_k = K d_k - l_k with d_k' = (q - d_k) / tau_k; here is the rest, l_k' = (F - l_k) / tau_k, and it
pushes with -sum_k g_k l_k.

With W the energy of the wall that has not relaxed, convex as no pattern loses all of its stiffness, and W* its
conjugate,

    W(q) + sum_k g_k (W*(h_k) - h_k . q)

is what it stores: its slope by q is the force, and a lag that goes a part of the way to N goes down in it, at any step.
Of a pattern, W* is known at once: with u = d - K^-1 l the linear displacement of h and theta = n . u / (m . t),

    W*(h) = u . K u / 2 + (m . t) g A(theta rho) / rho^2.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.reduction.softened_wall.load_pattern import Pattern, conjugate
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SoftenedWall

LEAST_J = 1e-16
"""Relaxation terms that store less are dropped."""


@kernel
def lags(wall: SoftenedWall) -> bool:
    """Whether any relaxation term is not zero."""
    for term in range(wall.lag.shape[0]):
        for mode in range(wall.lag.shape[1]):
            if wall.lag[term, mode] != 0.0:
                return True
    return False


@kernel
def lagging_j(wall: SoftenedWall, pattern: Pattern, q: FloatArray) -> float:
    """Return the energy of the relaxation terms less that of a linear wall's."""
    total = 0.0
    for term in range(wall.lag.shape[0]):
        s, stored = 0.0, 0.0
        for mode in range(q.shape[0]):
            d, lag = wall.followed[term, mode], wall.lag[term, mode]
            back = lag / wall.stiffness[mode]
            s += pattern.direction[mode] * (d - back - wall.rest_q[mode])
            stored += lag * (q[mode] - d + 0.5 * back)
        total += wall.g[term] * (stored + conjugate(pattern, s))
    return total


@kernel
def follow_lag(wall: SoftenedWall, q: FloatArray, phi: float, dt_s: float) -> None:
    """Relax towards the modes and towards the force ``phi`` along the pattern; write the resulting modal force."""
    wall.lagged[:] = 0.0
    energy = 0.0
    for term in range(wall.lag.shape[0]):
        decay = math.exp(-dt_s / wall.tau_s[term])
        for mode in range(q.shape[0]):
            force = phi * wall.pattern.direction[mode]
            wall.followed[term, mode] = q[mode] - decay * (q[mode] - wall.followed[term, mode])
            wall.lag[term, mode] = force - decay * (force - wall.lag[term, mode])
            wall.lagged[mode] -= wall.g[term] * wall.lag[term, mode]
            energy += wall.lag[term, mode] ** 2 / wall.stiffness[mode]
    if energy < LEAST_J and phi == 0.0:
        wall.lag[:] = 0.0
        wall.lagged[:] = 0.0
