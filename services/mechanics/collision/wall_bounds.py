"""Bounds on the motion of any node of the wall with the modes, from a reference.

With linear kinematics the bound is a sum over blocks of modes: with omega the frequencies, |Phi_i dq| is at most the
largest singular value of Phi_i / omega times |omega dq| (Cauchy-Schwarz). In a wall whose sections rotate, the motion
of the sections is added, which acts on the nodes' arms; the remaining motion is bounded in the same way.
"""

from __future__ import annotations

import itertools
import math
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, LongArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import copy_rows, row, squared_distance
from trocar.services.mechanics.reduction.large_rotations.warping import warped_tube
from trocar.services.mechanics.reduction.large_rotations.warping_kernels import WarpedTube, string_axis, take_axis
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct

_BLOCKS = 8
"""Number of blocks of modes; blocks of soft modes, which move far, are smaller."""


class WallBounds(Struct):
    """A reference for a wall of r modes in b blocks, whose sections rotate at s stations, or at none."""

    omega_rad_s: Annotated[FloatArray, "r"]
    edge: Annotated[LongArray, "b + 1"]  # of the blocks
    gain: Annotated[FloatArray, "b"]
    at_rest: Annotated[FloatArray, "r"]  # zeros
    reference: Annotated[FloatArray, "r"]
    tube: WarpedTube  # the axis at the coordinates of the last call
    turn: Annotated[FloatArray, "s", 3]  # of the stations in the reference
    centre: Annotated[FloatArray, "s", 3]
    longest_arm_m: float


def wall_bounds(duct: ReducedDuct, like: WallBounds | None = None) -> WallBounds:
    """Return bounds with the undeformed wall as reference; those of another wall of this duct cost nothing more."""
    modes = duct.basis.Phi if duct.warp is None else duct.warp.local
    omega, r = np.ascontiguousarray(duct.basis.omega_rad_s), duct.basis.n_modes
    edges = np.unique(np.round(r * np.linspace(0.0, 1.0, _BLOCKS + 1) ** 1.5).astype(int))
    spans = list(itertools.pairwise(edges))
    gain = [largest_gain(modes[:, :, a:b] / omega[a:b]).max() for a, b in spans] if like is None else like.gain
    tube = warped_tube(duct.warp, r)
    return WallBounds.zeros(
        omega_rad_s=omega,
        edge=edges,
        gain=np.asarray(gain),
        r=r,
        tube=tube,
        turn=tube.turn.copy(),
        centre=tube.centre.copy(),
        longest_arm_m=float(np.linalg.norm(tube.arm, axis=1).max(initial=0.0)),
    )


@kernel
def bound_motion(bounds: WallBounds, q: FloatArray, beyond_m: float) -> float:
    """Return a bound, in m, on any node's motion from the reference to q (r,), without that by loads.

    Sections move nodes by their arms, which loads lengthen by ``beyond_m``.
    """
    if bounds.turn.shape[0] > 0:
        string_axis(bounds.tube, q)
    return _bound_motion(bounds, q, (bounds.tube.turn, bounds.tube.centre), beyond_m)


@kernel
def bound_between(bounds: WallBounds, other: WallBounds, beyond_m: float) -> float:
    """Return that bound between two references."""
    return _bound_motion(bounds, other.reference, (other.turn, other.centre), beyond_m)


@kernel
def _bound_motion(bounds: WallBounds, q: FloatArray, axis: tuple[FloatArray, FloatArray], beyond_m: float) -> float:
    """Return the bound for coordinates whose axis has turns and centres (s, 3) at the stations."""
    moved_m, turned_2, carried_2 = _bound_by_blocks(bounds, bounds.reference, q), 0.0, 0.0
    if bounds.turn.shape[0] == 0:
        return moved_m
    for station in range(bounds.turn.shape[0]):
        turned_2 = max(turned_2, squared_distance(row(axis[0], station), row(bounds.turn, station)))
        carried_2 = max(carried_2, squared_distance(row(axis[1], station), row(bounds.centre, station)))
    arm_m = bounds.longest_arm_m + _bound_by_blocks(bounds, bounds.at_rest, q) + beyond_m
    return moved_m + math.sqrt(carried_2) + math.sqrt(turned_2) * arm_m


@kernel
def _bound_by_blocks(bounds: WallBounds, reference: FloatArray, q: FloatArray) -> float:
    """Return the sum over blocks of modes of their gain times |omega (q - reference)|."""
    total = 0.0
    for block in range(bounds.gain.shape[0]):
        square = 0.0
        for mode in range(bounds.edge[block], bounds.edge[block + 1]):
            square += (bounds.omega_rad_s[mode] * (q[mode] - reference[mode])) ** 2
        total += bounds.gain[block] * math.sqrt(square)
    return total


@kernel
def set_reference(bounds: WallBounds, q: FloatArray) -> None:
    """Count from these coordinates (r,)."""
    if bounds.turn.shape[0] > 0:
        string_axis(bounds.tube, q)
    _refer_to(bounds, q)


@kernel
def copy_reference(source: WallBounds, bounds: WallBounds) -> None:
    """Count from the reference of another wall of the same duct."""
    if bounds.turn.shape[0] > 0:
        take_axis(source.tube, source.reference, bounds.tube)
    _refer_to(bounds, source.reference)


@kernel
def _refer_to(bounds: WallBounds, q: FloatArray) -> None:
    for mode in range(q.shape[0]):
        bounds.reference[mode] = q[mode]
    copy_rows(bounds.tube.turn, bounds.turn, bounds.turn.shape[0])
    copy_rows(bounds.tube.centre, bounds.centre, bounds.turn.shape[0])


def largest_gain(modes: FloatArray) -> FloatArray:
    """Return the largest singular value (k,) of each (3, r) block, rounded up."""
    gram = modes @ modes.transpose(0, 2, 1)
    largest = np.linalg.eigvalsh(gram)[:, -1]
    gain: FloatArray = np.sqrt(np.maximum(largest, 0.0)) * (1.0 + 1e-9)
    return gain
