"""Kernels of the implicit step: assemble, solve, correct, and the compliance that contacts see."""

from __future__ import annotations

import math

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.rod.banded import HALF_BANDWIDTH, RHS_BLOCK, factor_ldl, solve_ldl, solve_ldl_block
from services.mechanics.rod.forces import add_internal_forces
from services.mechanics.rod.model import RodModel, RodWork, model_at, work_at

Motion = tuple[FloatArray, FloatArray]
Addresses = tuple[Address[RodModel], Address[RodWork]]

_TOLERANCE = 1e-3  # unasked stretch energy left by a step, over the energy in motion
_STILL = 1e-4  # of a segment length per step: what moves less than that is not refined
_HALVINGS = 6


@kernel
def predict(
    addresses: Addresses,
    motion: Motion,
    external: FloatArray,
    target: FloatArray,
    step: tuple[float, float, int],
) -> int:
    """Advance motion = (x, v) in place without contacts; return the Newton iterations taken.

    Zero iterations, and motion as it was, mean that a number was not finite. In the unknown y = x_theta - x, with
    h = theta dt, the step minimises |y - h v|_M^2 / (2 h^2) + V(x + y) - f.y; a Newton iteration is cut short where it
    would raise that, and no more follow one that leaves behind unasked stretch within _TOLERANCE of the energy in
    motion. So large rotations in one step do not become stretch, and stretch not motion.
    """
    model, work, (x, v) = model_at(addresses[0]), work_at(addresses[1]), motion
    dt_s, theta, max_iterations = step
    dv = work.velocity_change
    energy = _start(model, work, motion, target, (dt_s, theta))
    taken = 0
    while taken < max_iterations:
        _assemble(model, work, motion, external, (dt_s, theta))
        decrease = theta * theta * _newton_direction(model, work)
        if not math.isfinite(decrease):
            return 0
        energy = max(energy, decrease)
        share, excess = _line_search(model, work, theta * theta * dt_s, (decrease, _TOLERANCE * energy))
        for i in range(x.shape[0]):
            for c in range(3):
                dv[i, c] += share * work.rhs[3 * i + c]
        taken += 1
        if share == 1.0 and excess <= _TOLERANCE * energy:
            break
    for i in range(x.shape[0]):
        for c in range(3):
            x[i, c] += dt_s * (v[i, c] + theta * dv[i, c])
            v[i, c] += dv[i, c]
    return taken


@kernel
def _newton_direction(model: RodModel, work: RodWork) -> float:
    """Replace the right-hand side by the solution; return their scalar product, NaN for a matrix that is not SPD."""
    _remove_held(model, work)
    for i in range(work.rhs.shape[0]):
        work.residual[i] = work.rhs[i]
    if not factor_ldl(work.band):
        return math.nan
    solve_ldl(work.band, work.rhs)
    product = 0.0
    for k in range(work.rhs.shape[0]):
        product += work.residual[k] * work.rhs[k]
    return product


@kernel
def _start(model: RodModel, work: RodWork, motion: Motion, target: FloatArray, step: tuple[float, float]) -> float:
    """First iterate: held particles at their target (NaN: stay), free ones gone on as far as energy allows.

    That is h v, or a half, a quarter... of it, or nothing, so that it stretches the rod by no more than half of the
    kinetic energy that it spends. Returns the energy in motion [J], at least that of hardly visible motion.
    """
    x, v = motion
    dt_s, theta = step
    kinetic = 0.0
    floor = 0.0
    for i in range(x.shape[0]):
        floor += 0.5 * model.mass[i] * (_STILL * model.rest_length / dt_s) ** 2
        for c in range(3):
            work.velocity_change[i, c] = 0.0
            kinetic += 0.5 * model.mass[i] * v[i, c] * v[i, c]
    for k in range(model.held.shape[0]):
        i = model.held[k]
        for c in range(3):
            way = 0.0 if np.isnan(target[k, c]) else target[k, c] - x[i, c]
            work.velocity_change[i, c] = (way / dt_s - v[i, c]) / theta
    share = 1.0
    least = _stretched(model, work, motion, (0.0, dt_s, theta))
    while share > 0.1 and _stretched(model, work, motion, (share, dt_s, theta)) > least + 0.5 * share * kinetic:
        share *= 0.5
    if share < 0.1:
        share = 0.0
    if share < 1.0:
        for i in range(x.shape[0]):
            if not model.is_held[i]:
                for c in range(3):
                    work.velocity_change[i, c] = (share - 1.0) * v[i, c] / theta
    return kinetic + floor


@kernel
def _stretched(model: RodModel, work: RodWork, motion: Motion, way: tuple[float, float, float]) -> float:
    """Stretch energy with held particles at their target and free ones gone on by a share of their way."""
    x, v = motion
    share, dt_s, theta = way
    total = 0.0
    for j in range(model.EA.shape[0]):
        squared = 0.0
        for c in range(3):
            edge = x[j + 1, c] - x[j, c]
            for i, sign in ((j, -1.0), (j + 1, 1.0)):
                if model.is_held[i]:
                    edge += sign * theta * dt_s * (v[i, c] + theta * work.velocity_change[i, c])
                else:
                    edge += sign * share * theta * dt_s * v[i, c]
            squared += edge * edge
        total += 0.5 * model.EA[j] / model.rest_length * (math.sqrt(squared) - model.rest_length) ** 2
    return total


@kernel
def _line_search(model: RodModel, work: RodWork, scale: float, energy: tuple[float, float]) -> tuple[float, float]:
    """Share of the Newton step to take, and the stretch energy beyond the quadratic model that is left by it.

    ``energy`` is (decrease that the quadratic model promises for the full step, excess that does not matter).
    """
    decrease, slack = energy
    share = 1.0
    excess = 0.0
    for _ in range(_HALVINGS):
        excess = _excess_stretch(model, work, share * scale)
        if excess <= slack + (0.9 * share - 0.5 * share * share) * decrease:
            break
        share *= 0.5
    return share, excess


@kernel
def _excess_stretch(model: RodModel, work: RodWork, scale: float) -> float:
    """Stretch energy after moving the iterate by scale times the solution, minus its quadratic model at the iterate."""
    total = 0.0
    for j in range(model.EA.shape[0]):
        along = 0.0
        squared = 0.0
        for c in range(3):
            d = scale * (work.rhs[3 * j + 3 + c] - work.rhs[3 * j + c])
            along += d * work.tangent[j, c]
            squared += d * d
        length = work.length[j]
        moved = math.sqrt(max(length * length + 2.0 * length * along + squared, 0.0))
        strain = length - model.rest_length
        quadratic = strain * along + 0.5 * along * along
        if strain > 0.0:
            quadratic += 0.5 * strain / length * (squared - along * along)
        now = moved - model.rest_length
        total += model.EA[j] / model.rest_length * (0.5 * (now * now - strain * strain) - quadratic)
    return total


@kernel
def _assemble(model: RodModel, work: RodWork, motion: Motion, external: FloatArray, step: tuple[float, float]) -> None:
    """Residual dt f - M dv into the right-hand side, and A, both at the current iterate."""
    x, v = motion
    dt_s, theta = step
    h = theta * dt_s
    dv = work.velocity_change
    work.band[:] = 0.0
    for i in range(x.shape[0]):
        for c in range(3):
            work.previous_position[i, c] = x[i, c]
            work.previous_velocity[i, c] = v[i, c]
            work.velocity[i, c] = v[i, c] + theta * dv[i, c]
            work.position[i, c] = x[i, c] + h * work.velocity[i, c]
            work.force[i, c] = external[i, c] - model.drag[i] * work.velocity[i, c]
            work.band[3 * i + c, 0] = model.mass[i] + h * model.drag[i]
    add_internal_forces(model, work, (h * h + h * model.beta, h * h), h)
    for i in range(x.shape[0]):
        for c in range(3):
            work.rhs[3 * i + c] = dt_s * work.force[i, c] - model.mass[i] * dv[i, c]
    work.rhs[3 * x.shape[0] :] = 0.0


@kernel
def _remove_held(model: RodModel, work: RodWork) -> None:
    """Take held particles out of the system: unit diagonal, zero couplings, zero right-hand side."""
    for k in range(model.held.shape[0]):
        for c in range(3):
            j = 3 * model.held[k] + c
            work.rhs[j] = 0.0
            for a in range(1, HALF_BANDWIDTH + 1):
                work.band[j, a] = 0.0
                if a <= j:
                    work.band[j - a, a] = 0.0
            work.band[j, 0] = 1.0


@kernel
def correct(addresses: Addresses, motion: Motion, force: FloatArray, step: tuple[float, float]) -> None:
    """Add to motion = (x, v) what forces (n, 3), constant over the step, change: dv = dt A^-1 f, dx = theta dt dv."""
    model, work, (x, v) = model_at(addresses[0]), work_at(addresses[1]), motion
    dt_s, theta = step
    n = x.shape[0]
    for i in range(n):
        for c in range(3):
            work.rhs[3 * i + c] = 0.0 if model.is_held[i] else dt_s * force[i, c]
    work.rhs[3 * n :] = 0.0
    solve_ldl(work.band, work.rhs)
    for i in range(n):
        for c in range(3):
            v[i, c] += work.rhs[3 * i + c]
            x[i, c] += theta * dt_s * work.rhs[3 * i + c]


@kernel
def compliance(
    address: Address[RodModel],
    band: FloatArray,
    gain: float,
    columns: FloatArray,
    particles: IntArray,
    out: FloatArray,
) -> None:
    """Fill ``out`` (3k, 3k) with gain * A^-1 between ``particles`` (k,), given in ascending order."""
    model, k = model_at(address), particles.shape[0]
    for start in range(0, 3 * k, RHS_BLOCK):
        stop = min(start + RHS_BLOCK, 3 * k)
        first = 3 * particles[start // 3]
        columns[first:] = 0.0  # from eight rows before the first unknown on
        for column in range(start, stop):
            p = particles[column // 3]
            columns[HALF_BANDWIDTH + 3 * p + column % 3, column - start] = 0.0 if model.is_held[p] else gain
        solve_ldl_block(band, first, columns)
        for row in range(start, 3 * k):
            unknown = HALF_BANDWIDTH + 3 * particles[row // 3] + row % 3
            for column in range(start, min(stop, row + 1)):
                out[row, column] = columns[unknown, column - start]
                out[column, row] = out[row, column]


@kernel
def solve_many(
    address: Address[RodModel], band: FloatArray, gain: float, columns: FloatArray, force: FloatArray, out: FloatArray
) -> None:
    """Fill ``out`` (n, 3, m) with gain * A^-1 force, RHS_BLOCK right-hand sides at a time."""
    model, (n, _, m) = model_at(address), force.shape
    for start in range(0, m, RHS_BLOCK):
        stop = min(start + RHS_BLOCK, m)
        columns[:] = 0.0
        for i in range(n):
            if not model.is_held[i]:
                for c in range(3):
                    for column in range(start, stop):
                        columns[HALF_BANDWIDTH + 3 * i + c, column - start] = gain * force[i, c, column]
        solve_ldl_block(band, 0, columns)
        for i in range(n):
            for c in range(3):
                for column in range(start, stop):
                    out[i, c, column] = columns[HALF_BANDWIDTH + 3 * i + c, column - start]
