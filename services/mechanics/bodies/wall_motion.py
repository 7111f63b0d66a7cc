"""How points of the wall move with the modes: along straight lines, or with turning cross-sections.

The duct's body asks one of two objects, chosen once: no step looks whether large rotations are on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import kernel
from services.mechanics.reduction.basis import gather_modes
from services.mechanics.reduction.duct import ReducedDuct
from services.mechanics.reduction.large_rotations.warping import SectionFrame, TubeWarp
from services.mechanics.reduction.residual.turned import TurnedResidual


class StraightMotion:
    """x = X + Phi q.

    Attributes
    ----------
    reduced : ReducedDuct
        Its residual compliance acts along world axes.
    """

    def __init__(self, reduced: ReducedDuct) -> None:
        self.reduced = reduced

    def update(self, q: FloatArray) -> None:
        """Take over the state; there is nothing to prepare."""

    def gather(self, nodes: IntArray, weights: FloatArray, out: FloatArray) -> None:
        """Write d x / d q at points of triangles, ``nodes`` and ``weights`` (k, 3), into ``out`` (3 k, r)."""
        gather_modes(nodes, weights, self.reduced.basis.Phi, out)

    def add_bend(self, nodes: IntArray, weights: FloatArray, rows: FloatArray, q: FloatArray, out: FloatArray) -> None:
        """Add to ``out`` (k, 3) what is in the displacement of points beside ``rows`` (3 k, r) times q: nothing."""

    def positions(self, nodes: IntArray, q: FloatArray) -> FloatArray:
        """Return where ``nodes`` (k,) are without contact loads, (k, 3) in m."""
        at: FloatArray = self.reduced.mesh.vertices_m[nodes] + self.reduced.basis.Phi[nodes] @ q
        return at


class TurnedMotion:
    """x of `reduction.warping`; ``reduced`` has its residual compliance turned along."""

    def __init__(self, reduced: ReducedDuct, warp: TubeWarp, n_points: int) -> None:
        self._frame = SectionFrame(warp)
        self.reduced = replace(reduced, residual=TurnedResidual.of(reduced.residual, self._frame, n_points))
        self._corners_m = np.zeros((3 * n_points, 3))
        self._no_residual_m = np.zeros((3 * n_points, 3))

    def update(self, q: FloatArray) -> None:
        """String the sections together at q."""
        self._frame.update(q)

    def gather(self, nodes: IntArray, weights: FloatArray, out: FloatArray) -> None:
        """Write d x / d q at points of triangles, ``nodes`` and ``weights`` (k, 3), into ``out`` (3 k, r)."""
        self._frame.gather_rows(nodes, weights, out)

    def add_bend(self, nodes: IntArray, weights: FloatArray, rows: FloatArray, q: FloatArray, out: FloatArray) -> None:
        """Add to ``out`` (k, 3) what is in the displacement of points beside ``rows`` (3 k, r) times q."""
        corners, flat = self._corners_m[: nodes.size], nodes.reshape(-1)
        self._frame.node_positions(flat, self._no_residual_m[: nodes.size], corners)
        add_displacement_beside_rows((flat, weights), self.reduced.mesh.vertices_m, corners, rows, q, out)

    def positions(self, nodes: IntArray, q: FloatArray) -> FloatArray:
        """Return where ``nodes`` (k,) are without contact loads, (k, 3) in m; q is that of the last update."""
        at = np.empty((len(nodes), 3))
        self._frame.node_positions(nodes, np.zeros_like(at), at)
        return at


def wall_motion(reduced: ReducedDuct, n_points: int) -> StraightMotion | TurnedMotion:
    """Return how this duct moves, for up to ``n_points`` contact points."""
    return StraightMotion(reduced) if reduced.warp is None else TurnedMotion(reduced, reduced.warp, n_points)


@kernel
def add_displacement_beside_rows(
    points: tuple[IntArray, FloatArray],
    rest: FloatArray,
    corners: FloatArray,
    rows: FloatArray,
    q: FloatArray,
    out: FloatArray,
) -> None:
    """Add the displacement of points, (nodes (3 k,), weights (k, 3)), less rows (3 k, r) times q to ``out`` (k, 3)."""
    nodes, weights = points
    for point in range(weights.shape[0]):
        for axis in range(3):
            row = 3 * point + axis
            beside = 0.0
            for corner in range(3):
                moved = corners[3 * point + corner, axis] - rest[nodes[3 * point + corner], axis]
                beside += weights[point, corner] * moved
            for mode in range(q.shape[0]):
                beside -= rows[row, mode] * q[mode]
            out[point, axis] += beside
