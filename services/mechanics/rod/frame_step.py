"""The implicit step of a rod with a material frame.

Directors stay while particles move, so the step is taken twice: with the frame where the velocities lead in half of it,
and again where the first solution leads. If it were taken once, fixed directors would act like a mass, dt^2/4 times the
stiffness that their turning takes away, and a twisted rod would flutter below its critical torque.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.rod.free_step import SLEPT, FreeStep, begin_own, end_freely, step_at
from trocar.services.mechanics.rod.implicit_kernels import Addresses, Moving, Step, predict
from trocar.services.mechanics.rod.model import work_at
from trocar.services.mechanics.rod.turning import note_turns
from trocar.services.mechanics.rod.twist import Task, update_frame

_NOTHING = 1e-100  # products of numbers below it would be subnormal, and ten times as slow


@kernel
def step_freely_with_frame(
    address: Address[FreeStep],
    rod: tuple[Addresses, Task],
    scratch: tuple[FloatArray, FloatArray],
    motion: Moving,
    step: Step,
    flags: tuple[bool, bool],
) -> int:
    """Do as `free_step.step_freely`; ``scratch`` is that of `predict_with_frame`, and the targets of held particles."""
    own, (x, v, _), (is_touched, may_sleep) = step_at(address), motion, flags
    if begin_own(own, x, v, may_sleep):
        return SLEPT
    load = own.load if is_touched else own.external
    taken = predict_with_frame(rod, scratch[0], motion, (load, scratch[1]), step)
    return int(end_freely(own, rod[0], (x, v), (step[0], taken, is_touched)))


@kernel
def predict_with_frame(
    rod: tuple[Addresses, Task], scratch: FloatArray, motion: Moving, load: tuple[FloatArray, FloatArray], step: Step
) -> int:
    """Do as `implicit_kernels.predict` does, for ``load`` = (external forces, targets of held particles).

    ``scratch`` (7, n, 3) gets the motion at the start, positions and velocities in the middle, the frame's force and
    the sum of all forces.
    """
    (addresses, task), start, middle, force, taken = rod, scratch[:3], scratch[3:5], scratch[5], 0
    for k in range(3):
        for i in range(force.shape[0]):
            for c in range(3):
                start[k, i, c] = 0.0 if abs(motion[k][i, c]) < _NOTHING else motion[k][i, c]
    middle[1] = start[1]
    for is_again in (False, True):
        for i in range(force.shape[0]):
            for c in range(3):
                if is_again:
                    middle[1, i, c] = (motion[0][i, c] - start[0, i, c]) / step[0]
                for k in range(3):
                    motion[k][i, c] = start[k, i, c]
                middle[0, i, c], force[i, c] = start[0, i, c] + 0.5 * step[0] * middle[1, i, c], 0.0
        update_frame(task, (middle[0], middle[1]), (step[0], is_again), force)
        note_turns(addresses[1], task[0], middle[0], task[1])
        for i in range(force.shape[0]):
            for c in range(3):
                scratch[6, i, c] = load[0][i, c] + force[i, c]
        more = predict(addresses, motion, scratch[6], load[1], step, is_again)
        taken += more
        if more == 0 or not work_at(addresses[1]).is_middle:
            return taken if more > 0 else 0
    return taken
