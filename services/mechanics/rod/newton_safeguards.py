"""Safeguards of the Newton iteration: a start without spurious stretch, a line search, and a stretch correction."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.rod.banded import solve_ldl
from trocar.services.mechanics.rod.elasticity import bending_excess
from trocar.services.mechanics.rod.generalized_alpha import StepForm
from trocar.services.mechanics.rod.introducer_forces import introducer_excess
from trocar.services.mechanics.rod.model import RodModel, RodWork

_NEGLIGIBLE_MOTION = 1e-4  # motion, in segment lengths per step, below which no further iteration is needed
_MAX_MOTION = 0.15  # largest relative motion of a segment's ends, in segment lengths (or radians) per step
_HALVINGS = 6


@kernel
def put_held(model: RodModel, work: RodWork, x: FloatArray, v: FloatArray, target: FloatArray, dt_s: float) -> float:
    """Write the change of velocity of held particles, which move uniformly to their target (NaN: they stay).

    Return the kinetic energy [J] plus that of a negligible motion.
    """
    kinetic, floor = 0.0, 0.0
    for i in range(x.shape[0]):
        floor += 0.5 * model.mass[i] * (_NEGLIGIBLE_MOTION * model.rest_length[0] / dt_s) ** 2
        for c in range(3):
            kinetic += 0.5 * model.mass[i] * v[i, c] * v[i, c]
    for k in range(model.held.shape[0]):
        i = model.held[k]
        for c in range(3):
            way = 0.0 if np.isnan(target[k, c]) else target[k, c] - x[i, c]
            work.velocity_change[i, c] = way / dt_s - v[i, c]
    return kinetic + floor


@inlined_kernel
def turns_little(model: RodModel, x: FloatArray, v: FloatArray, dt_s: float) -> bool:
    """Return whether no segment would rotate or stretch by more than _FARTHEST in a step with its present velocity."""
    for j in range(x.shape[0] - 1):
        limit = (_MAX_MOTION * model.rest_length[j] / dt_s) ** 2
        squared = 0.0
        for c in range(3):
            squared += (v[j + 1, c] - v[j, c]) ** 2
        if squared > limit:
            return False
    return True


@inlined_kernel
def start_guarded(model: RodModel, work: RodWork, x: FloatArray, v: FloatArray, step: tuple[float, float]) -> None:
    """Start the iteration with a fraction of the free particles' velocity: 1, 1/2, 1/4, 1/8 or 0.

    With this fraction the stretch energy of the start is at most half of the kinetic energy that the motion gives up.
    ``step`` is (dt, kinetic energy in J).
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
    """Return the stretch energy [J] with held particles at their target, and free ones moved by v times share times dt.

    ``way`` is (share, dt).
    """
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
    """Return the fraction of the Newton step to take, and its excess: the energy [J] beyond the quadratic model.

    The excess is that of the nonlinear terms: stretch, bending and introducer. ``energy`` is (decrease of the quadratic
    model for the full step, negligible excess).
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
    """Return the length of segment j at the end of the step without and with a fraction of the solution.

    The other two numbers are the relative motion of its ends along the direction in which forces are taken, and the
    square of this motion in all directions.
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
    """Return the stretch energy [J] at the end of the step with a fraction of the solution, minus its quadratic model.

    The model is that of the matrix: it has the directions and tensions of the segments where forces are taken.
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
    """Replace the solution by a correction to the exact stretch, with the same matrix; return the error's energy [J].

    The error is a segment's rotation times the transverse motion of its ends. Without the correction it would return a
    step later as a force along the segment, which has rotated meanwhile: a stiff rod that rotates by some hundredths of
    a radian per step would flutter.
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
