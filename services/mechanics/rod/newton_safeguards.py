"""Safeguards of the Newton iteration: a start without false stretch, a line search, and a correction for stretch."""

from __future__ import annotations

import math

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.rod.banded import solve_ldl
from services.mechanics.rod.elasticity import bending_excess
from services.mechanics.rod.generalized_alpha import StepForm
from services.mechanics.rod.introducer_forces import introducer_excess
from services.mechanics.rod.model import RodModel, RodWork

_STILL = 1e-4  # of a segment length per step: slower motion needs no further iteration
_FARTHEST = 0.15  # of a segment length (or a radian) per step
_HALVINGS = 6


@kernel
def put_held(model: RodModel, work: RodWork, x: FloatArray, v: FloatArray, target: FloatArray, dt_s: float) -> float:
    """Start without change of velocity, but move held particles evenly to their target (NaN: stay).

    Return the energy in motion [J], at least that of hardly visible motion.
    """
    kinetic, floor = 0.0, 0.0
    for i in range(x.shape[0]):
        floor += 0.5 * model.mass[i] * (_STILL * model.rest_length[0] / dt_s) ** 2
        for c in range(3):
            work.velocity_change[i, c] = 0.0
            kinetic += 0.5 * model.mass[i] * v[i, c] * v[i, c]
    for k in range(model.held.shape[0]):
        i = model.held[k]
        for c in range(3):
            way = 0.0 if np.isnan(target[k, c]) else target[k, c] - x[i, c]
            work.velocity_change[i, c] = way / dt_s - v[i, c]
    return kinetic + floor


@kernel
def turns_little(model: RodModel, x: FloatArray, v: FloatArray, dt_s: float) -> bool:
    """Return whether no segment turns or stretches by more than _FARTHEST in a step."""
    for j in range(x.shape[0] - 1):
        most = (_FARTHEST * model.rest_length[j] / dt_s) ** 2
        squared = 0.0
        for c in range(3):
            squared += (v[j + 1, c] - v[j, c]) ** 2
        if squared > most:
            return False
    return True


@kernel
def start_guarded(model: RodModel, work: RodWork, x: FloatArray, v: FloatArray, step: tuple[float, float]) -> None:
    """Start free particles with a share of their velocity: 1, a half, a quarter... or nothing.

    The share is small enough that the start stretches the rod by at most half of the kinetic energy that it spends.
    ``step`` is (dt, energy in motion).
    """
    dt_s, kinetic = step
    share = 1.0
    least = _stretched(model, work, x, v, (0.0, dt_s))
    while share > 0.1 and _stretched(model, work, x, v, (share, dt_s)) > least + 0.5 * share * kinetic:
        share *= 0.5
    if share < 0.1:
        share = 0.0
    for i in range(x.shape[0]):
        for c in range(3):
            if not model.is_held[i]:
                work.velocity_change[i, c] = (share - 1.0) * v[i, c]


@kernel
def _stretched(model: RodModel, work: RodWork, x: FloatArray, v: FloatArray, way: tuple[float, float]) -> float:
    """Return the stretch energy with held particles at their target and free ones moved by a share of their way."""
    share, dt_s = way
    total = 0.0
    for j in range(model.EA.shape[0]):
        squared = 0.0
        for c in range(3):
            edge = x[j + 1, c] - x[j, c]
            for i, sign in ((j, -1.0), (j + 1, 1.0)):
                if model.is_held[i]:
                    edge += sign * dt_s * (v[i, c] + work.velocity_change[i, c])
                else:
                    edge += sign * share * dt_s * v[i, c]
            squared += edge * edge
        total += 0.5 * model.EA[j] / model.rest_length[j] * (math.sqrt(squared) - model.rest_length[j]) ** 2
    return total


@inlined_kernel
def line_search(model: RodModel, work: RodWork, form: StepForm, energy: tuple[float, float]) -> tuple[float, float]:
    """Return the share of the Newton step to take, and the energy [J] that it leaves beyond the quadratic model.

    This energy is of stretch, bending and the introducer: of all that is not linear.

    ``energy`` is (decrease that the quadratic model promises for the full step, excess that does not matter).
    """
    decrease, slack = energy
    share = 1.0
    excess = 0.0
    for _ in range(_HALVINGS):
        excess = _excess_stretch(model, work, form, share) + bending_excess(model, work, share * form.mean * form.dt_s)
        if model.introducer.is_there:
            excess += introducer_excess(model, work, work.position, share * form.mean * form.dt_s)
        if excess <= slack + (0.9 * share - 0.5 * share * share) * decrease:
            break
        share *= 0.5
    return share, excess


@kernel
def _end_lengths(work: RodWork, form: StepForm, share: float, j: int) -> tuple[float, float, float, float]:
    """Return the length of segment j at the end of the step before and after a share of the solution moves it.

    Then follows the motion of its ends apart, along its direction where forces are taken, and squared in all
    directions.
    """
    x = work.previous_position
    scale = share * form.mean * form.dt_s
    beyond = 1.0 / form.at - 1.0
    along, squared, before, after = 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        d = scale * (work.rhs[3 * j + 3 + c] - work.rhs[3 * j + c])
        along += d * work.tangent[j, c]
        squared += d * d
        end = (1.0 + beyond) * work.length[j] * work.tangent[j, c] - beyond * (x[j + 1, c] - x[j, c])
        before += end * end
        after += (end + d) * (end + d)
    return math.sqrt(before), math.sqrt(after), along, squared


@kernel
def _excess_stretch(model: RodModel, work: RodWork, form: StepForm, share: float) -> float:
    """Return the stretch energy at the step's end after a share of the solution moves it, minus its quadratic model.

    The model is that of the matrix: with the segments' directions and tensions where forces are taken.
    """
    total = 0.0
    for j in range(model.EA.shape[0]):
        before, after, along, squared = _end_lengths(work, form, share, j)
        strain = before - model.rest_length[j]
        quadratic = strain * along + 0.5 * along * along
        if work.taut[j] > 0.0:
            quadratic += 0.5 * work.taut[j] / max(work.length[j], model.rest_length[j]) * (squared - along * along)
        now = after - model.rest_length[j]
        total += model.EA[j] / model.rest_length[j] * (0.5 * (now * now - strain * strain) - quadratic)
    return total


@kernel
def correct_stretch(model: RodModel, work: RodWork, form: StepForm) -> float:
    """Replace the solution by its correction for the exact stretch, with the same matrix; return its energy [J].

    Without it the error, a segment's turn times its particles' motion aside, would come back a step later as a force
    along the segment that has turned on: a stiff rod turning by some hundredths of a radian a step would flutter.
    """
    n = work.velocity_change.shape[0]
    energy = 0.0
    pull_x, pull_y, pull_z = 0.0, 0.0, 0.0
    for j in range(n - 1):
        before, after, along, _ = _end_lengths(work, form, 1.0, j)
        error = after - before - along
        k = model.EA[j] / model.rest_length[j]
        energy += 0.5 * k * error * error
        pull = form.at * form.dt_s * work.chord[j] * k * error
        x, y, z = pull * work.tangent[j, 0], pull * work.tangent[j, 1], pull * work.tangent[j, 2]
        work.residual[3 * j] = x - pull_x
        work.residual[3 * j + 1] = y - pull_y
        work.residual[3 * j + 2] = z - pull_z
        pull_x, pull_y, pull_z = x, y, z
    work.residual[3 * n - 3] = -pull_x
    work.residual[3 * n - 2] = -pull_y
    work.residual[3 * n - 1] = -pull_z
    for i in range(n):
        for c in range(3):
            work.rhs[3 * i + c] = 0.0 if model.is_held[i] else work.residual[3 * i + c]
    work.rhs[3 * n :] = 0.0
    solve_ldl(work.band, work.rhs)
    return energy
