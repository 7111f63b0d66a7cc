"""Energy checks of a step: whether it has gained energy, and the error of the linear contact correction."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import dot
from trocar.services.mechanics.rod.elasticity import bending_angle
from trocar.services.mechanics.rod.introducer_forces import introducer_energy
from trocar.services.mechanics.rod.model import RodModel, RodWork

# Motions in a step below which its energy is not checked, in segment lengths (or radians): relative motion of a
# segment's ends, and sliding through an introducer.
_SLOW = 0.02
_SLIDES = 0.05
# Allowed gain of a step as a fraction of its kinetic energy: the energy of a second-order step oscillates by this much.
_GAIN = 0.01
# Tolerated error of the linear contact correction: as a fraction of the motion's energy, and as a strain of a segment.
_STRETCH = 1e-3
_STRAIN = 1e-4


@kernel
def elastic_energy(model: RodModel, x: FloatArray) -> float:
    """Return the energy [J] of stretch, bending, clamps and introducer of a rod at ``x`` (n, 3), without scratch."""
    total, before = 0.0, (0.0, 0.0, 0.0)
    last = x.shape[0] - 2
    for j in range(last + 1):
        edge = (x[j + 1, 0] - x[j, 0], x[j + 1, 1] - x[j, 1], x[j + 1, 2] - x[j, 2])
        length = math.sqrt(dot(edge, edge))
        tangent = (edge[0] / length, edge[1] / length, edge[2] / length) if length > 0.0 else before
        total += 0.5 * model.EA[j] / model.rest_length[j] * (length - model.rest_length[j]) ** 2
        if j > 0:
            total += 0.5 * model.joint_stiffness[j - 1] * bending_angle(before, tangent)[0] ** 2
        for end in range(2):
            if j == end * last and not np.isnan(model.walls[end, 0]):
                wall = (model.walls[end, 0], model.walls[end, 1], model.walls[end, 2])
                total += 0.5 * model.wall_stiffness[end] * bending_angle(wall, tangent)[0] ** 2
        before = tangent
    if model.introducer.is_there:
        total += introducer_energy(model, x)
    return total


@inlined_kernel
def gains(model: RodModel, x: FloatArray, v: FloatArray, work: RodWork, load: FloatArray) -> bool:
    """Return whether the step from (x, v) to the end in ``work`` gains more energy than the work of ``load`` (n, 3).

    A step that rotates and slides the rod by little is not checked, unless it reverses the sliding: a bent rod may
    oscillate in its introducer from step to step, and gain a tenth each time. A step whose held particles move is not
    checked either, because a hand does work there.
    """
    end, dv = work.end_position, work.velocity_change
    slides = model.introducer.is_there and (_slides_far(model, x, end) or _slides_back(model, v, dv))
    if _turns_little(model, x, end) and not slides:
        return False
    for k in range(model.held.shape[0]):
        for c in range(3):
            if end[model.held[k], c] != x[model.held[k], c]:
                return False
    kinetic, change = 0.0, 0.0
    for i in range(x.shape[0]):
        for c in range(3):
            kinetic += 0.5 * model.mass[i] * v[i, c] * v[i, c]
            change += model.mass[i] * dv[i, c] * (v[i, c] + 0.5 * dv[i, c]) - load[i, c] * (end[i, c] - x[i, c])
    change += elastic_energy(model, end) - elastic_energy(model, x)
    return bool(change > _GAIN * (kinetic + kinetic_energy(model, v, dv)))


@inlined_kernel
def kinetic_energy(model: RodModel, v: FloatArray, dv: FloatArray) -> float:
    """Return the kinetic energy [J] at the velocities v + dv (n, 3)."""
    total = 0.0
    for i in range(v.shape[0]):
        for c in range(3):
            total += 0.5 * model.mass[i] * (v[i, c] + dv[i, c]) ** 2
    return total


@inlined_kernel
def _turns_little(model: RodModel, x: FloatArray, end: FloatArray) -> bool:
    """Return whether the relative motion of no segment's ends exceeds _SLOW times its length."""
    for j in range(x.shape[0] - 1):
        squared = 0.0
        for c in range(3):
            squared += (end[j + 1, c] - x[j + 1, c] - end[j, c] + x[j, c]) ** 2
        limit = _SLOW * model.rest_length[j]
        if squared > limit * limit:
            return False
    return True


@inlined_kernel
def _slides_far(model: RodModel, x: FloatArray, end: FloatArray) -> bool:
    """Return whether the first particle, which the introducer guides, moves further than _SLIDES of a segment."""
    squared = 0.0
    for c in range(3):
        squared += (end[0, c] - x[0, c]) ** 2
    return bool(squared > (_SLIDES * model.rest_length[0]) ** 2)


@inlined_kernel
def _slides_back(model: RodModel, v: FloatArray, dv: FloatArray) -> bool:
    """Return whether the first particle reverses its motion along the introducer in a step."""
    before, change = 0.0, 0.0
    for c in range(3):
        before += v[0, c] * model.introducer.axis[c]
        change += dv[0, c] * model.introducer.axis[c]
    return bool(before * (before + change) < 0.0)
