r"""Energy that changing contact forces add to a rod beyond their work, and its removal from the rod's velocities.

A step is predicted with the contact forces :math:`f_0` of the last step, held constant by the midpoint rule, and
corrected by implicit Euler for their change. The energy of a free mass m then changes by :math:`f_1 \Delta x - (f_1 -
f_0) f_1 \Delta t^2 / 2 m`. So it loses energy when a force grows, and gains when a force falls, at most half as much as
it had lost. The correction also moves the rod along straight lines. So if forces change noticeably, the gain is
computed from the rod's energies before and after the step, damping included. The velocities are scaled down to remove
it, and the part that exceeds their kinetic energy is carried over as a debt.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.rod.free_step import FreeStep, step_at
from trocar.services.mechanics.rod.implicit_kernels import Addresses, Motion
from trocar.services.mechanics.rod.model import RodModel, RodWork, model_at, work_at
from trocar.services.mechanics.rod.step_energy import elastic_energy
from trocar.services.mechanics.rod.twist import Task as TwistTask
from trocar.services.mechanics.rod.twist import energy_at

# Smaller gains are ignored. It is a tenth of the kinetic energy of a catheter at a millimetre per second.
NEGLIGIBLE_J = 1e-9


@inlined_kernel
def remove_energy_gain(model: RodModel, work: RodWork, step: FreeStep, motion: Motion, dt_s: float) -> None:
    """Remove the energy that a step has gained from the velocities of a rod without twist.

    ``work.rhs`` is the change of the velocities by contact forces.
    """
    if is_significant(model, work, step, motion, dt_s):
        remove_gain(model, step, motion, 0.0)


@kernel
def remove_energy_gain_with_twist(
    rod: Addresses, address: Address[FreeStep], motion: Motion, dt_s: float, twist: TwistTask
) -> None:
    """Do as `remove_energy_gain` for a rod whose material frame also stores energy; the frame is not changed."""
    model, step, x = model_at(rod[0]), step_at(address), motion[0]
    if is_significant(model, work_at(rod[1]), step, motion, dt_s):
        remove_gain(model, step, motion, energy_at(twist, x) - energy_at(twist, step.start))


@kernel
def is_significant(model: RodModel, work: RodWork, step: FreeStep, motion: Motion, dt_s: float) -> bool:
    """Return whether changes of contact forces matter; never if held particles move, because a hand does work there.

    ``work.rhs`` is the change of the velocities by contact forces.
    """
    x, change_work_j = motion[0], 0.0
    for k in range(model.held.shape[0]):
        for c in range(3):
            if x[model.held[k], c] != step.start[model.held[k], c]:
                return False
    for i in range(x.shape[0]):
        for c in range(3):
            change_work_j -= 0.5 * dt_s * (step.contact[i, c] + step.negated_contact[i, c]) * work.rhs[3 * i + c]
    return bool(abs(change_work_j) >= NEGLIGIBLE_J or step.owed_j != 0.0)


@kernel
def remove_gain(model: RodModel, step: FreeStep, motion: Motion, other_gain_j: float) -> None:
    """Remove a step's energy gain from the velocities; ``other_gain_j`` (J) is a gain that is not computed here."""
    (x, v), gain_j, kinetic_j = motion, step.owed_j + other_gain_j, 0.0
    for i in range(x.shape[0]):
        for c in range(3):
            before, force = step.start_velocity[i, c], step.external[i, c] + step.contact[i, c]
            gain_j -= 0.5 * model.mass[i] * before * before + force * (x[i, c] - step.start[i, c])
            kinetic_j += 0.5 * model.mass[i] * v[i, c] * v[i, c]
    gain_j += kinetic_j + elastic_energy(model, x) - elastic_energy(model, step.start)
    removed_j = min(max(gain_j, 0.0), kinetic_j)
    step.owed_j = max(gain_j - removed_j, 0.0)
    if removed_j > 0.0:
        share = math.sqrt(1.0 - removed_j / kinetic_j)
        for i in range(x.shape[0]):
            for c in range(3):
                v[i, c] *= share
