r"""What contact forces that change within a step put into a rod beyond their work, taken out of its motion.

A step is planned with the contact forces :math:`f_0` of the last one, held over it by the midpoint rule, and corrected
by implicit Euler for their change. A mass m that nothing else holds then gains :math:`f_1 \Delta x - (f_1 - f_0) f_1
\Delta t^2 / 2 m`: it loses where a force grows, and gains where one falls off, half as much as it had lost at most.
And the correction goes along straight lines. Where forces change by anything that counts, the rod's energies before and
after the step say what it has gained in truth, damping included. Its velocities are scaled down for it, and what they
do not hold is owed.
"""

from __future__ import annotations

import math

from services.mechanics.compiled import kernel
from services.mechanics.rod.free_step import FreeStep
from services.mechanics.rod.implicit_kernels import Motion
from services.mechanics.rod.model import RodModel, RodWork
from services.mechanics.rod.step_energy import elastic_energy

# A tenth of what a catheter's length holds at a millimetre per second: less is not looked at.
LEAST_J = 1e-9


@kernel
def pay_for_change(model: RodModel, work: RodWork, step: FreeStep, motion: Motion, dt_s: float) -> None:
    """Take out of the velocities what the step has gained.

    ``work.rhs`` is what contact forces have changed them by.
    """
    (x, v), swung_j = motion, 0.0
    for i in range(x.shape[0]):
        for c in range(3):
            swung_j -= 0.5 * dt_s * (step.contact[i, c] + step.relief[i, c]) * work.rhs[3 * i + c]
    if abs(swung_j) < LEAST_J and step.owed_j == 0.0:
        return
    gained_j, kinetic_j = step.owed_j, 0.0
    for i in range(x.shape[0]):
        for c in range(3):
            before, force = step.start_velocity[i, c], step.external[i, c] + step.contact[i, c]
            gained_j -= 0.5 * model.mass[i] * before * before + force * (x[i, c] - step.start[i, c])
            kinetic_j += 0.5 * model.mass[i] * v[i, c] * v[i, c]
    gained_j += kinetic_j + elastic_energy(model, x) - elastic_energy(model, step.start)
    paid_j = min(max(gained_j, 0.0), kinetic_j)
    step.owed_j = max(gained_j - paid_j, 0.0)
    if paid_j > 0.0:
        share = math.sqrt(1.0 - paid_j / kinetic_j)
        for i in range(x.shape[0]):
            for c in range(3):
                v[i, c] *= share
