r"""Energy that changing contact forces put into a rod beyond their work; it is taken out of the rod's velocities.

A step is planned with the contact forces :math:`f_0` of the last one, held over it by the midpoint rule, and corrected
by implicit Euler for their change. A mass m that nothing else holds then gains :math:`f_1 \Delta x - (f_1 - f_0) f_1
\Delta t^2 / 2 m`: it loses where a force grows, and gains where one falls off, half as much as it had lost at most.
The correction also moves the rod along straight lines. Where forces change noticeably, the gain is therefore computed
from the rod's energies before and after the step, damping included. The velocities are scaled down by it, and the part
that they do not hold is carried as a debt.
"""

from __future__ import annotations

import math

from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.rod.free_step import FreeStep, step_at
from services.mechanics.rod.implicit_kernels import Addresses, Motion
from services.mechanics.rod.model import RodModel, RodWork, model_at, work_at
from services.mechanics.rod.step_energy import elastic_energy
from services.mechanics.rod.twist import Task as TwistTask
from services.mechanics.rod.twist import energy_at

# A tenth of the kinetic energy of a catheter at a millimetre per second: smaller gains are ignored.
LEAST_J = 1e-9


@inlined_kernel
def pay_for_change(model: RodModel, work: RodWork, step: FreeStep, motion: Motion, dt_s: float) -> None:
    """Subtract the energy that a step has gained from the velocities of a rod without twist.

    ``work.rhs`` is the change of the velocities by contact forces.
    """
    if is_looked_at(model, work, step, motion, dt_s):
        pay(model, step, motion, 0.0)


@kernel
def pay_for_change_with_twist(
    rod: Addresses, address: Address[FreeStep], motion: Motion, dt_s: float, twist: TwistTask
) -> None:
    """Do as `pay_for_change` for a rod whose material frame also stores energy; the frame is not changed."""
    model, step, x = model_at(rod[0]), step_at(address), motion[0]
    if is_looked_at(model, work_at(rod[1]), step, motion, dt_s):
        pay(model, step, motion, energy_at(twist, x) - energy_at(twist, step.start))


@kernel
def is_looked_at(model: RodModel, work: RodWork, step: FreeStep, motion: Motion, dt_s: float) -> bool:
    """Return whether changes of contact forces matter; not where held particles move, as a hand works there.

    ``work.rhs`` is the change of the velocities by contact forces.
    """
    x, swung_j = motion[0], 0.0
    for k in range(model.held.shape[0]):
        for c in range(3):
            if x[model.held[k], c] != step.start[model.held[k], c]:
                return False
    for i in range(x.shape[0]):
        for c in range(3):
            swung_j -= 0.5 * dt_s * (step.contact[i, c] + step.negated_contact[i, c]) * work.rhs[3 * i + c]
    return bool(abs(swung_j) >= LEAST_J or step.owed_j != 0.0)


@kernel
def pay(model: RodModel, step: FreeStep, motion: Motion, more_j: float) -> None:
    """Subtract a step's energy gain from the velocities; ``more_j`` (J) is the part of energies not computed here."""
    (x, v), gained_j, kinetic_j = motion, step.owed_j + more_j, 0.0
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
