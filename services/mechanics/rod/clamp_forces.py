"""Forces of clamped ends, with their positive semidefinite tangent."""

from __future__ import annotations

import math

from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import row
from trocar.services.mechanics.rod.elasticity import (
    Scale,
    bending_angle,
    bent_length,
    geometric_bending,
    joint_gradient,
)
from trocar.services.mechanics.rod.model import RodModel, RodWork


@inlined_kernel
def add_wall_joints(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add the forces of the half joints between walls and end segments, with a stiffness of 2 EI/l0 each.

    A half joint is the same bending spring as a joint of the rod, but one of its two tangents is fixed in space.
    """
    last = work.length.shape[0] - 1
    if not math.isnan(model.walls[0, 0]):
        wall = row(model.walls, 0)
        segment = row(work.tangent, 0)
        theta, b = bending_angle(wall, segment)
        joint_gradient(wall, segment, (math.inf, bent_length(model, work, 0)), b, work.gradient)
        _apply_wall(model, work, theta, (0, 3), scale)
    if not math.isnan(model.walls[1, 0]):
        wall = row(model.walls, 1)
        segment = row(work.tangent, last)
        theta, b = bending_angle(segment, wall)
        joint_gradient(segment, wall, (bent_length(model, work, last), math.inf), b, work.gradient)
        _apply_wall(model, work, theta, (last, 0), scale)


@kernel
def _apply_wall(model: RodModel, work: RodWork, theta: float, where: tuple[int, int], scale: Scale) -> None:
    """Add the force of a half joint at angle ``theta`` (rad), and its tangent.

    ``work.gradient`` has three particles, of which two exist; ``where`` is (first of these, its place in the gradient).
    """
    first, shift = where
    gradient = work.gradient
    k = model.wall_stiffness[0 if shift else 1]
    out_of_plane = k * geometric_bending(theta)
    lead, across = 0.0, 0.0
    for a in range(6):
        lead += gradient[0, shift + a] * work.lead[0, first + a // 3, a % 3]
        across += gradient[1, shift + a] * work.lead[1, first + a // 3, a % 3]
    for a in range(6):
        moments = k * (theta + lead) * gradient[0, shift + a] + out_of_plane * across * gradient[1, shift + a]
        work.force[first + a // 3, a % 3] -= moments
    if scale[0] > 0.0:
        for kind, factor in ((0, scale[0] * k), (1, scale[1] * out_of_plane)):
            for c in range(6):
                for a in range(6 - c):
                    work.band[3 * first + c, a] += factor * gradient[kind, shift + c] * gradient[kind, shift + c + a]
