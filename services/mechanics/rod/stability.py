"""The largest time step of the semi-implicit integrator, from the stiffest mode of the straight rod."""

from __future__ import annotations

import math

import numpy as np
import scipy

from trocar.services.mechanics.rod.banded import HALF_BANDWIDTH
from trocar.services.mechanics.rod.forces import add_internal_forces
from trocar.services.mechanics.rod.model import RodModel, allocate_work
from trocar.services.mechanics.rod.supports import IntroducerSprings


def largest_frequency_rad_s(model: RodModel) -> float:
    """Return the largest angular frequency [rad/s] of the unstretched straight rod, held particles removed.

    It is the root of the largest eigenvalue of M^-1/2 K M^-1/2, with K from the same kernels as the step, including
    clamped ends. As an upper bound, an introducer adds twice its stiffness and that of a stop to every particle: near
    its ends two springs may act on one. A tension T, which is not included, adds about 4 T/(m l0) to the eigenvalue.
    """
    n = model.mass.shape[0]
    work = allocate_work(n)
    work.position[1:, 0] = np.cumsum(model.rest_length)
    walls = np.where(np.isnan(model.walls), np.nan, [1.0, 0.0, 0.0])
    straight = RodModel(
        mass=model.mass,
        drag=model.drag,
        EA=model.EA,
        joint_stiffness=model.joint_stiffness,
        rest_length=model.rest_length,
        growth=model.growth,
        tip=model.tip,
        beta=0.0,
        walls=walls,
        wall_stiffness=model.wall_stiffness,
        introducer=IntroducerSprings.zeros(),
        held=model.held,
        is_held=model.is_held,
    )
    add_internal_forces(straight, work, (1.0, 1.0))
    if model.introducer.is_there:
        work.band[: 3 * n, 0] += np.tile([0.0, 2.0, 2.0], n) * model.introducer.stiffness
        work.band[0 : 3 * n : 3, 0] += model.introducer.stop_stiffness
    scale = np.repeat(np.where(model.is_held, 0.0, 1.0 / np.sqrt(model.mass)), 3)
    padded = np.concatenate((scale, np.zeros(HALF_BANDWIDTH)))
    band = np.stack([work.band[: 3 * n, a] * scale * padded[a : a + 3 * n] for a in range(HALF_BANDWIDTH + 1)])
    top = scipy.linalg.eigvals_banded(band, lower=True, select="i", select_range=(3 * n - 1, 3 * n - 1))
    return math.sqrt(max(float(top[0]), 0.0))


def stable_time_step(model: RodModel) -> float:
    """Return the largest stable step h of semi-implicit Euler, in s.

    It satisfies (omega h)^2 + 2 c h < 4 with c = b/m + beta omega^2, from the Jury conditions of
    ``v += -h (omega^2 x + c v), x += h v``. The largest frequency and the largest drag per mass are the worst case.
    """
    omega = largest_frequency_rad_s(model)
    c = float(np.max(model.drag / model.mass)) + model.beta * omega**2
    return (math.sqrt(c * c + 4.0 * omega**2) - c) / omega**2
