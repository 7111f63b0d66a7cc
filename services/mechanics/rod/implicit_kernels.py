"""Kernels of the implicit step without contacts."""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.rod.banded import HALF_BANDWIDTH, factor_ldl, solve_ldl
from trocar.services.mechanics.rod.forces import add_internal_forces, add_internal_tangent
from trocar.services.mechanics.rod.generalized_alpha import (
    StepForm,
    damping_scale,
    generalized_alpha,
    implicit_euler,
    stiffness_scale,
)
from trocar.services.mechanics.rod.model import RodModel, RodWork, model_at, work_at
from trocar.services.mechanics.rod.newton_safeguards import (
    correct_stretch,
    line_search,
    put_held,
    start_guarded,
    turns_little,
)
from trocar.services.mechanics.rod.step_energy import gains

Motion = tuple[FloatArray, FloatArray]
Moving = tuple[FloatArray, FloatArray, FloatArray]
Step = tuple[float, float, int, bool]
Addresses = tuple[Address[RodModel], Address[RodWork]]

_TOLERANCE = 1e-3  # spurious stretch energy that a step may leave, as a fraction of the kinetic energy
_PATIENCE = 2  # iterations of the second-order step before implicit Euler


@kernel
def predict(
    addresses: Addresses, motion: Moving, external: FloatArray, target: FloatArray, step: Step, goes_on: bool = False
) -> int:
    """Advance motion = (x, v, w) in place without contacts; return the Newton iterations taken.

    ``step`` is (dt, spectral radius, maximum number of iterations, whether this is the first step). With ``goes_on`` it
    starts with the change of velocity and the factors of the last call. If a number is not finite, zero iterations are
    returned, with motion unchanged. One iteration of the second-order step is enough if its spurious stretch energy is
    at most _TOLERANCE times the kinetic energy. If segments rotate too far, or the step would gain energy, the step is
    taken by implicit Euler: it minimises |y - dt v|_M^2 / (2 dt^2) + V(x + y) - f.y over the displacements y, with a
    line search for Newton iterations that would increase this. So large rotations in a step do not become stretch, and
    stretch does not become motion.
    """
    model, work, (x, v, _) = model_at(addresses[0]), work_at(addresses[1]), motion
    dt_s, rho, max_iterations, is_start = step
    if not goes_on:
        work.velocity_change[:] = 0.0
    energy = put_held(model, work, x, v, target, dt_s)
    taken = 0
    if not is_start and turns_little(model, x, v, dt_s):
        form = generalized_alpha(dt_s, rho)
        taken = _newton(model, work, motion, external, (form, energy, _PATIENCE, goes_on))
        if taken > 0:
            _take_end(model, work, motion, form)
            if gains(model, x, v, work, external):
                taken = -taken
            else:
                _finish(model, work, motion, form)
        if taken >= 0:
            return taken
    work.velocity_change[:] = 0.0
    put_held(model, work, x, v, target, dt_s)
    _grow(model, 0.5 * dt_s)  # to the end of the step, where its forces are taken
    start_guarded(model, work, x, v, (dt_s, energy))
    form = implicit_euler(dt_s)
    more = abs(_newton(model, work, motion, external, (form, energy, max_iterations, False)))
    _grow(model, -0.5 * dt_s)
    if more == 0:
        return 0
    _finish(model, work, motion, form)
    return more - taken


@kernel
def _grow(model: RodModel, time_s: float) -> None:
    for j in range(model.growth.shape[0]):
        model.rest_length[j] += time_s * model.growth[j]


@kernel
def _newton(
    model: RodModel, work: RodWork, motion: Moving, external: FloatArray, task: tuple[StepForm, float, int, bool]
) -> int:
    """Iterate; return the number of iterations, negative without convergence, 0 if a number is not finite.

    ``task`` is (form, kinetic energy in J, maximum number of iterations, whether the first takes the last factors).
    """
    form, energy, most, is_factored = task
    taken = 0
    while taken < most:
        _take_configuration(model, work, motion, form)
        _assemble(model, work, external, form, is_factored)
        if work.hits_stop:
            return -taken - 1
        decrease, is_factored = _newton_direction(model, work, is_factored), False
        if not math.isfinite(decrease):
            return 0
        taken += 1
        if form.at < 1.0:
            _add_solution(work, 1.0)
            error = correct_stretch(model, work, form)
            _add_solution(work, 1.0)
            if error <= _TOLERANCE * energy:
                return taken
        else:
            energy = max(energy, decrease)
            share, excess = line_search(model, work, form, (decrease, _TOLERANCE * energy))
            _add_solution(work, share)
            if share == 1.0 and excess <= _TOLERANCE * energy:
                return taken
    return -most


@kernel
def _add_solution(work: RodWork, share: float) -> None:
    for i in range(work.velocity_change.shape[0]):
        for c in range(3):
            work.velocity_change[i, c] += share * work.rhs[3 * i + c]


@kernel
def _mean_velocity(model: RodModel, work: RodWork, v: FloatArray, form: StepForm, i: int, c: int) -> float:
    """Return the mean velocity over the step; a held particle moves to its target at a constant velocity."""
    mean = 1.0 if model.is_held[i] else form.mean
    return float(v[i, c] + mean * work.velocity_change[i, c])


@kernel
def _take_configuration(model: RodModel, work: RodWork, motion: Moving, form: StepForm) -> None:
    """Write the positions, leads and velocities at which forces are taken, for the present velocity change."""
    x, v, w = motion
    dv = work.velocity_change
    work.is_middle = form.at < 1.0
    work.hits_stop = False
    for i in range(x.shape[0]):
        for c in range(3):
            mean = _mean_velocity(model, work, v, form, i, c)
            leading = mean + form.speed_change * dv[i, c] + form.speed_lag * (mean - w[i, c])
            work.previous_position[i, c] = x[i, c]
            work.position[i, c] = x[i, c] + form.at * form.dt_s * mean
            work.end_position[i, c] = x[i, c] + form.dt_s * mean
            work.leading_velocity[i, c] = leading
            work.lead[1, i, c] = form.dt_s * (form.lead_change * dv[i, c] + form.lead_lag * (mean - w[i, c]))
            work.lead[0, i, c] = work.lead[1, i, c] + model.beta * leading


@inlined_kernel
def _take_end(model: RodModel, work: RodWork, motion: Moving, form: StepForm) -> None:
    """Write the positions at the end of the step, for the present velocity change."""
    x, v, _ = motion
    for i in range(x.shape[0]):
        for c in range(3):
            work.end_position[i, c] = x[i, c] + form.dt_s * _mean_velocity(model, work, v, form, i, c)


@kernel
def _finish(model: RodModel, work: RodWork, motion: Moving, form: StepForm) -> None:
    x, v, w = motion
    for i in range(x.shape[0]):
        for c in range(3):
            mean = _mean_velocity(model, work, v, form, i, c)
            x[i, c] += form.dt_s * mean
            v[i, c] += work.velocity_change[i, c]
            w[i, c] += form.follow * (mean - w[i, c])


@inlined_kernel
def _newton_direction(model: RodModel, work: RodWork, is_factored: bool) -> float:
    """Replace the right-hand side by the solution; return their scalar product, NaN if the matrix is not SPD."""
    if not is_factored:
        remove_held(model, work)
    for k in range(model.held.shape[0]):
        work.rhs[3 * model.held[k] : 3 * model.held[k] + 3] = 0.0
    for i in range(work.rhs.shape[0]):
        work.residual[i] = work.rhs[i]
    if not (is_factored or factor_ldl(work.band)):
        return math.nan
    solve_ldl(work.band, work.rhs)
    product = 0.0
    for k in range(work.rhs.shape[0]):
        product += work.residual[k] * work.rhs[k]
    return product


@inlined_kernel
def _assemble(model: RodModel, work: RodWork, external: FloatArray, form: StepForm, is_factored: bool) -> None:
    """Write the residual dt f - M dv into the right-hand side, and A unless it is factored, at the current iterate."""
    n = external.shape[0]
    for i in range(n):
        for c in range(3):
            work.force[i, c] = external[i, c] - model.drag[i] * work.leading_velocity[i, c]
    add_internal_forces(model, work, (0.0, 0.0) if is_factored else _begin_matrix(model, work, form))
    for i in range(n):
        for c in range(3):
            work.rhs[3 * i + c] = form.dt_s * work.force[i, c] - model.mass[i] * work.velocity_change[i, c]
    work.rhs[3 * n :] = 0.0


@inlined_kernel
def assemble_again(model: RodModel, work: RodWork, form: StepForm) -> None:
    """Write the matrix of another form of the step, at the configuration where forces were taken last."""
    add_internal_tangent(model, work, _begin_matrix(model, work, form))


@kernel
def _begin_matrix(model: RodModel, work: RodWork, form: StepForm) -> tuple[float, float]:
    """Write mass and drag into the matrix, and return the scales of the tangents to be added, see `elasticity`."""
    stiff, damped = stiffness_scale(form), damping_scale(form)
    work.band[:] = 0.0
    for i in range(model.mass.shape[0]):
        for c in range(3):
            work.band[3 * i + c, 0] = model.mass[i] + damped * model.drag[i]
    return stiff + damped * model.beta, stiff


@kernel
def remove_held(model: RodModel, work: RodWork) -> None:
    """Remove held particles from the system: unit diagonal, zero couplings, zero right-hand side."""
    for k in range(model.held.shape[0]):
        for c in range(3):
            j = 3 * model.held[k] + c
            work.rhs[j] = 0.0
            for a in range(1, HALF_BANDWIDTH + 1):
                work.band[j, a] = 0.0
                if a <= j:
                    work.band[j - a, a] = 0.0
            work.band[j, 0] = 1.0
