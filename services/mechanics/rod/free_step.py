"""The step of a rod without contact forces in one kernel, and the test whether a rod at rest can skip it."""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.rod import contact_response, implicit_kernels
from trocar.services.mechanics.rod.implicit_kernels import Addresses

# Speed below which a particle is at rest: a tenth of a micrometre per second is neither visible nor felt.
SLEEP_SPEED_M_S = 1e-7
# Values of `step_freely` other than the number of iterations.
SLEPT, NOT_DEFINITE = -1, -2


class FreeStep(Struct):
    """State at the start of a step without contact forces, and the loads of the step; n particles."""

    start: Annotated[FloatArray, "n", 3]
    motion: Annotated[FloatArray, "n", 3]
    constant: Annotated[FloatArray, "n", 3]  # loads that act in every step
    external: Annotated[FloatArray, "n", 3]  # all loads except contacts
    last_external: Annotated[FloatArray, "n", 3]  # those of the last step that was not skipped
    contact: Annotated[FloatArray, "n", 3]  # contact forces of the last step
    load: Annotated[FloatArray, "n", 3]  # sum of ``external`` and ``contact``
    negated_contact: Annotated[FloatArray, "n", 3]  # minus ``contact``, for the correction
    start_velocity: Annotated[FloatArray, "n", 3]
    owed_j: float = 0.0  # see `contact_energy_gain`


step_at = reader(FreeStep)


@kernel
def step_freely(
    address: Address[FreeStep],
    rod: Addresses,
    motion: implicit_kernels.Moving,
    target: FloatArray,
    step: tuple[float, float, int, bool],
    flags: tuple[bool, bool],
) -> int:
    """Advance motion = (x, v, w) without contact forces, and store start and motion; arguments as for `predict`.

    ``flags`` = (had contacts in the last step, may sleep). With contacts, the prediction includes the last contact
    forces, and the correction subtracts them. Return the number of Newton iterations, 0 if a number was not finite,
    `SLEPT`, or `NOT_DEFINITE` if the matrix of the correction is not positive definite.
    """
    own, (x, v, _), (is_touched, may_sleep) = step_at(address), motion, flags
    if begin_own(own, x, v, may_sleep):
        return SLEPT
    taken: int = implicit_kernels.predict(rod, motion, own.load if is_touched else own.external, target, step)
    return end_freely(own, rod, (x, v), (step[0], taken, is_touched))


@kernel
def end_freely(own: FreeStep, rod: Addresses, motion: implicit_kernels.Motion, step: tuple[float, int, bool]) -> int:
    """Subtract the last contact forces from a predicted motion, and store it; see `step_freely`.

    ``step`` is (dt, Newton iterations of the prediction, whether it had contacts in the last step).
    """
    dt_s, taken, is_touched = step
    if taken == 0:
        return taken
    if is_touched and not contact_response.correct(rod, motion, own.negated_contact, (dt_s, False)):
        return NOT_DEFINITE
    for i in range(motion[0].shape[0]):
        for axis in range(3):
            own.motion[i, axis] = motion[0][i, axis] - own.start[i, axis]
    return taken


@kernel
def begin_step(address: Address[FreeStep], position: FloatArray, velocity: FloatArray, may_sleep: bool) -> bool:
    """Store the start (n, 3) of a step and its loads; return whether the step can be skipped, see `is_at_rest`."""
    return bool(begin_own(step_at(address), position, velocity, may_sleep))


@kernel
def continue_sleep(address: Address[FreeStep], position: FloatArray, velocity: FloatArray) -> bool:
    """If the step can be skipped (`is_at_rest`), store its start and return True; else do nothing."""
    step = step_at(address)
    if not _is_at_rest(step, velocity):
        return False
    return bool(begin_own(step, position, velocity, may_sleep=True))


@kernel
def begin_own(step: FreeStep, position: FloatArray, velocity: FloatArray, may_sleep: bool) -> bool:
    """Do as `begin_step`."""
    is_asleep = bool(may_sleep and _is_at_rest(step, velocity))
    for i in range(position.shape[0]):
        for axis in range(3):
            step.start[i, axis] = position[i, axis]
            step.start_velocity[i, axis] = velocity[i, axis]
            if is_asleep:
                step.motion[i, axis] = 0.0
                continue
            step.last_external[i, axis] = step.external[i, axis]
            step.load[i, axis] = step.external[i, axis] + step.contact[i, axis]
            step.negated_contact[i, axis] = -step.contact[i, axis]
    return is_asleep


@kernel
def is_at_rest(address: Address[FreeStep], velocity: FloatArray) -> bool:
    """Return whether all particles (n, 3) are at rest, and the loads are those of the last step not skipped."""
    return bool(_is_at_rest(step_at(address), velocity))


@kernel
def _is_at_rest(step: FreeStep, velocity: FloatArray) -> bool:
    for i in range(velocity.shape[0]):
        for axis in range(3):
            is_slow = abs(velocity[i, axis]) < SLEEP_SPEED_M_S
            if not (is_slow and step.external[i, axis] == step.last_external[i, axis]):
                return False
    return True
