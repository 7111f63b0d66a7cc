"""A rod's step without contact forces, from its loads to its motion, in one kernel; and whether it is taken at all."""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.rod import contact_response, implicit_kernels
from services.mechanics.rod.implicit_kernels import Addresses

# A tenth of a micrometre in a second and a half: far below what is seen or felt.
SLEEP_SPEED_M_S = 1e-7
# What `step_freely` returns besides the number of iterations.
SLEPT, NOT_DEFINITE = -1, -2


class FreeStep(Struct):
    """What a step of a rod without contact forces begins with; n particles."""

    start: Annotated[FloatArray, "n", 3]
    motion: Annotated[FloatArray, "n", 3]
    constant: Annotated[FloatArray, "n", 3]  # loads in every step
    external: Annotated[FloatArray, "n", 3]  # loads
    last_external: Annotated[FloatArray, "n", 3]  # those of the last step that moved it
    contact: Annotated[FloatArray, "n", 3]  # contact forces of the last step
    load: Annotated[FloatArray, "n", 3]  # both loads
    relief: Annotated[FloatArray, "n", 3]  # what takes the contact forces out again


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
    """Advance motion = (x, v, w) without contact forces, and note start and motion; arguments of `predict`.

    ``flags`` say whether contacts touched it in the last step, whose forces the prediction then takes with it and the
    correction takes out again, and whether it may sleep. Return the Newton iterations taken, 0 where a number was not
    finite, `SLEPT`, or `NOT_DEFINITE` where the matrix that takes the forces out again is not.
    """
    own, (x, v, _), (is_touched, may_sleep) = step_at(address), motion, flags
    if _begin(own, x, v, may_sleep):
        return SLEPT
    taken: int = implicit_kernels.predict(rod, motion, own.load if is_touched else own.external, target, step)
    if taken == 0:
        return taken
    if is_touched and not contact_response.correct(rod, (x, v), own.relief, (step[0], False)):
        return NOT_DEFINITE
    for i in range(x.shape[0]):
        for axis in range(3):
            own.motion[i, axis] = x[i, axis] - own.start[i, axis]
    return taken


@kernel
def begin_step(address: Address[FreeStep], position: FloatArray, velocity: FloatArray, may_sleep: bool) -> bool:
    """Note the start (n, 3) of a step and its loads; return whether it is left out, see `hangs_still`."""
    return bool(_begin(step_at(address), position, velocity, may_sleep))


@kernel
def sleep_on(address: Address[FreeStep], position: FloatArray, velocity: FloatArray) -> bool:
    """Do what a step does that is left out, and return True, if this one is: see `hangs_still`; else do nothing."""
    step = step_at(address)
    if not _hangs_still(step, velocity):
        return False
    return bool(_begin(step, position, velocity, may_sleep=True))


@kernel
def _begin(step: FreeStep, position: FloatArray, velocity: FloatArray, may_sleep: bool) -> bool:
    is_asleep = bool(may_sleep and _hangs_still(step, velocity))
    for i in range(position.shape[0]):
        for axis in range(3):
            step.start[i, axis] = position[i, axis]
            if is_asleep:
                step.motion[i, axis] = 0.0
                continue
            step.last_external[i, axis] = step.external[i, axis]
            step.load[i, axis] = step.external[i, axis] + step.contact[i, axis]
            step.relief[i, axis] = -step.contact[i, axis]
    return is_asleep


@kernel
def hangs_still(address: Address[FreeStep], velocity: FloatArray) -> bool:
    """Return whether no particle (n, 3) moves and the loads are those of the last step that moved them."""
    return bool(_hangs_still(step_at(address), velocity))


@kernel
def _hangs_still(step: FreeStep, velocity: FloatArray) -> bool:
    for i in range(velocity.shape[0]):
        for axis in range(3):
            is_slow = abs(velocity[i, axis]) < SLEEP_SPEED_M_S
            if not (is_slow and step.external[i, axis] == step.last_external[i, axis]):
                return False
    return True
