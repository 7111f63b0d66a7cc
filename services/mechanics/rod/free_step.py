"""The step of a rod without contact forces in one kernel, and the test whether a rod at rest can skip it."""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.rod import contact_response, implicit_kernels
from services.mechanics.rod.banded import solve_ldl
from services.mechanics.rod.implicit_kernels import Addresses
from services.mechanics.rod.model import model_at, work_at
from services.mechanics.rod.step_energy import linearisation_error_j

# Speed below which a particle is at rest: a tenth of a micrometre per second is neither visible nor felt.
SLEEP_SPEED_M_S = 1e-7
# Motion below which nonlinearity is negligible: a hundredth of a millimetre hardly rotates a segment.
NEGLIGIBLE_MOTION_M = 1e-5
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
    start_slow: Annotated[FloatArray, "n", 3]  # see `generalized_alpha`
    linearised_end: Annotated[FloatArray, "n", 3]  # end of the step with the contact forces of the linearisation
    solved: Annotated[FloatArray, "n", 3]  # contact forces of this step, before they are applied
    base: Annotated[FloatArray, "n", 3]  # contact forces of the best linearisation
    solved_from_base: Annotated[FloatArray, "n", 3]  # the contact forces solved with it
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
    own, (x, v, w), (is_touched, may_sleep) = step_at(address), motion, flags
    if _begin(own, x, v, may_sleep):
        return SLEPT
    _copy(w, own.start_slow)
    taken: int = implicit_kernels.predict(rod, motion, own.load if is_touched else own.external, target, step)
    if taken == 0:
        return taken
    _copy(x, own.linearised_end)
    if is_touched and not contact_response.correct(rod, (x, v), own.negated_contact, (step[0], False)):
        return NOT_DEFINITE
    _note_motion(own, x)
    return taken


@kernel
def _copy(source: FloatArray, out: FloatArray) -> None:
    for i in range(source.shape[0]):
        for axis in range(3):
            out[i, axis] = source[i, axis]


@kernel
def _note_motion(step: FreeStep, position: FloatArray) -> None:
    for i in range(position.shape[0]):
        for axis in range(3):
            step.motion[i, axis] = position[i, axis] - step.start[i, axis]


@kernel
def nonlinear_error_j(address: Address[FreeStep], rod: Addresses, is_touched: bool, step: tuple[float, bool]) -> float:
    """Return the energy in J that the linear correction neglects for the solved contact forces; 0.0 if negligible.

    ``step`` is (dt, whether the matrix for contacts is factorised); it is factorised afterwards. If even free particles
    would move by less than `NEGLIGIBLE_MOTION_M`, nothing is computed.
    """
    own, model, work = step_at(address), model_at(rod[0]), work_at(rod[1])
    n, squared, lightest = own.start.shape[0], 0.0, model.mass[0]
    for i in range(n):
        lightest = min(lightest, model.mass[i])
        for axis in range(3):
            change = own.solved[i, axis] - (own.contact[i, axis] if is_touched else 0.0)
            work.rhs[3 * i + axis] = 0.0 if model.is_held[i] else step[0] ** 2 * change
            squared += change * change
    if squared * step[0] ** 4 < (NEGLIGIBLE_MOTION_M * lightest) ** 2:
        return 0.0
    if not (step[1] or contact_response.factor_for_contacts(rod, step[0])):
        return 0.0
    work.rhs[3 * n :] = 0.0
    solve_ldl(work.band, work.rhs)
    return float(linearisation_error_j(model, own.linearised_end, work, step[0]))


@kernel
def relinearise(
    address: Address[FreeStep],
    rod: Addresses,
    motion: implicit_kernels.Moving,
    frame_force: FloatArray,
    target: FloatArray,
    step: tuple[float, float, int, float],
) -> int:
    """Repeat the step, linearised with contact forces between `base` (share 0) and `solved_from_base` (share 1).

    Implicit Euler takes it, as it takes contacts: by the midpoint rule, held forces would throw back what they stop.
    ``frame_force`` (n, 3) is the force of a material frame; ``step`` is (dt, spectral radius, most iterations, share).
    Return values are those of `step_freely`.
    """
    own, (x, v, w) = step_at(address), motion
    for i in range(x.shape[0]):
        for axis in range(3):
            x[i, axis], v[i, axis] = own.start[i, axis], own.start_velocity[i, axis]
            w[i, axis] = own.start_slow[i, axis]
            own.contact[i, axis] = own.base[i, axis] + step[3] * (own.solved_from_base[i, axis] - own.base[i, axis])
            own.load[i, axis] = own.external[i, axis] + own.contact[i, axis] + frame_force[i, axis]
            own.negated_contact[i, axis] = -own.contact[i, axis]
    taken: int = implicit_kernels.predict(rod, motion, own.load, target, (step[0], step[1], step[2], True))
    if taken == 0:
        return taken
    _copy(x, own.linearised_end)
    if not contact_response.correct(rod, (x, v), own.negated_contact, (step[0], False)):
        return NOT_DEFINITE
    _note_motion(own, x)
    return taken


@kernel
def begin_step(address: Address[FreeStep], position: FloatArray, velocity: FloatArray, may_sleep: bool) -> bool:
    """Store the start (n, 3) of a step and its loads; return whether the step can be skipped, see `is_at_rest`."""
    return bool(_begin(step_at(address), position, velocity, may_sleep))


@kernel
def continue_sleep(address: Address[FreeStep], position: FloatArray, velocity: FloatArray) -> bool:
    """If the step can be skipped (`is_at_rest`), store its start and return True; else do nothing."""
    step = step_at(address)
    if not _is_at_rest(step, velocity):
        return False
    return bool(_begin(step, position, velocity, may_sleep=True))


@kernel
def _begin(step: FreeStep, position: FloatArray, velocity: FloatArray, may_sleep: bool) -> bool:
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
