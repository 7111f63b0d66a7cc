"""Motion of wall points with the modes: along straight lines, or with turning cross-sections.

The duct's body holds one of two objects, chosen once, so that no step tests whether large rotations are on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.bodies.contact_corners import ContactCorners, apply_corner_displacements, list_corners
from trocar.services.mechanics.bodies.turned_points import (
    displace_turned,
    follow_axis,
    gather_turned,
    place_points,
    turn_along,
    weigh_turned,
)
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.reduction.coincident_points import copy_coincident, find_sources
from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame, TubeWarp
from trocar.services.mechanics.reduction.large_rotations.warping_kernels import WarpedTube
from trocar.services.mechanics.reduction.modal_compliance import add_modal_compliance
from trocar.services.mechanics.reduction.node_compliance import Loads, NodeArrays, NodeCompliance, PointRows, Points
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.residual.blocks import apply
from trocar.services.mechanics.reduction.residual.rotated_residual import RotatedResidual


class PointCompliance:
    """Compliance and residual displacement of up to ``n_points`` contact points, without a cache.

    Attributes:
        reduced: ReducedDuct. Its residual compliance acts along world axes.
        kept_address: Address[NodeArrays] or None. Where kernels find the compliance cached between nodes, if there is a
            cache.
        sections: tuple of Address[WarpedTube]. See `DuctBody.sections`.
    """

    kept_address: Address[NodeArrays] | None = None
    sections: tuple[Address[WarpedTube], Address[WarpedTube]] = (Address(0), Address(0))

    def __init__(self, reduced: ReducedDuct, n_points: int) -> None:
        self.reduced = reduced
        self._corners = ContactCorners.allocate(n_points)
        self._slot = np.full(reduced.mesh.n_vertices, -1, np.int32)
        self._scaled_modes = np.zeros(3 * n_points * reduced.basis.n_modes)
        self._source = np.zeros(n_points, np.int32)

    def turn_to_wall(self, nodes: IntArray, vectors: FloatArray) -> None:
        """Turn vectors (k, 3) of nodes (k,), in place, from world axes into those of the wall, which are the same."""

    def turn_to_world(self, nodes: IntArray, vectors: FloatArray) -> None:
        """Turn vectors back, in place."""

    def turn_along(self, nodes: IntArray, vectors: FloatArray, q: FloatArray) -> None:
        """Turn vectors (k, 3) of nodes (k,), in place, as the wall turns from the last `update` to q: it does not."""

    def add_residual(self, points: Points, loads: Loads, out: tuple[FloatArray, FloatArray]) -> None:
        """Add displacements by ``loads`` beyond the modes to those of points (k, 3); subtract them from the motions."""
        (nodes, weights), corners = points, self._corners
        u = list_corners(nodes, weights, self._slot, corners.address)
        self.reduced.residual.apply(loads[0], loads[1], corners.node[:u], corners.displacement_m[:u])
        apply_corner_displacements(weights, corners.address, u, out)

    def compliance(self, points: Points, rows: FloatArray, gain: FloatArray, out: FloatArray, first: int = 0) -> int:
        """Write the compliance between points, with their ``rows`` of the modes, into the lower blocks of ``out``.

        What couples the points before ``first`` is there already. Return the first point whose blocks were written:
        that one, or 0.
        """
        self.compliance_uncached(points, rows, gain, out)
        return 0

    def compliance_uncached(self, points: Points, rows: FloatArray, gain: FloatArray, out: FloatArray) -> None:
        """Write the same as `compliance`, without the cache."""
        source = self._source[: len(points[0])]
        find_sources(points, source, 0)
        self.reduced.residual.gather_points(points[0], points[1], out, source)
        add_modal_compliance(rows, gain, self._scaled_modes, out, source, 0)
        copy_coincident(source, out, 0)


class StraightMotion(PointCompliance):
    """x = X + Phi q: the compliance between nodes is constant, so that of touched nodes is cached."""

    def __init__(self, reduced: ReducedDuct, n_points: int) -> None:
        super().__init__(reduced, n_points)
        self._kept = NodeCompliance(reduced, n_points)
        self.kept_address = self._kept.address

    def update(self, q: FloatArray) -> None:
        """Do nothing: straight motion depends on no prepared state."""

    def gather(self, points: Points, motion: tuple[FloatArray, FloatArray], loads: Loads, out: PointRows) -> None:
        """Write d x / d q at points, and their displacements and motions; ``motion`` is q and its change.

        Displacements by ``loads`` beyond the modes are added to the former and subtracted from the latter.
        """
        if not self._kept.gather_points(points, motion, loads, out):
            super().add_residual(points, loads, (out[1], out[2]))

    def add_residual(self, points: Points, loads: Loads, out: tuple[FloatArray, FloatArray]) -> None:
        """Do as `PointCompliance.add_residual`."""
        if not self._kept.displace(points, loads, out):
            super().add_residual(points, loads, out)

    def compliance(self, points: Points, rows: FloatArray, gain: FloatArray, out: FloatArray, first: int = 0) -> int:
        """Do as `PointCompliance.compliance`."""
        if self._kept.gather(points, gain, out, first):
            return first
        self.compliance_uncached(points, rows, gain, out)
        return 0

    def position_function(self, nodes: IntArray) -> Callable[[FloatArray], FloatArray]:
        """Return a function of q that gives the positions (k, 3) in m of ``nodes`` (k,) without contact loads."""
        rest_m, modes = self.reduced.mesh.vertices_m[nodes], self.reduced.basis.Phi[nodes]
        return lambda q: rest_m + modes @ q


class TurnedMotion(PointCompliance):
    """x of `reduction.large_rotations.warping`; ``reduced`` has its residual compliance turned along.

    That is constant along the wall's own axes, so that of touched nodes is kept.
    """

    def __init__(self, reduced: ReducedDuct, warp: TubeWarp, n_points: int) -> None:
        self._frame, self._end_frame = SectionFrame(warp), SectionFrame(warp)
        turned = RotatedResidual.of(reduced.residual, self._frame, n_points)
        super().__init__(replace(reduced, residual=turned), n_points)
        self._kept, self._rotations = NodeCompliance(reduced, n_points), np.zeros((3 * n_points, 3, 3))
        self._load_n, self._residual_m = np.zeros((6 * n_points, 3)), np.zeros((3 * n_points, 3))
        self._corner_rows = np.zeros((3 * n_points, 3, reduced.basis.n_modes))
        self.sections = self._frame.address, self._end_frame.address
        self._places = self._frame.address, self._kept.address, self._corners.address

    def update(self, q: FloatArray) -> None:
        """Compute the sections' positions and rotations at q, where the last step has ended, mostly."""
        follow_axis(self._frame.address, self._end_frame.address, q)

    def turn_to_wall(self, nodes: IntArray, vectors: FloatArray) -> None:
        """Turn vectors (k, 3) of nodes (k,), in place, from world axes into those of their sections at rest."""
        self._frame.turn_back(nodes, vectors, vectors)

    def turn_to_world(self, nodes: IntArray, vectors: FloatArray) -> None:
        """Turn vectors back, in place."""
        self._frame.turn_vectors(nodes, vectors, vectors)

    def turn_along(self, nodes: IntArray, vectors: FloatArray, q: FloatArray) -> None:
        """Turn vectors (k, 3) of nodes (k,), in place, as their sections turn from the last `update` to q."""
        if len(nodes):
            turn_along(self._frame.address, self._end_frame.address, q, nodes, vectors)

    def gather(self, points: Points, motion: tuple[FloatArray, FloatArray], loads: Loads, out: PointRows) -> None:
        """Write the same as `StraightMotion.gather`; ``motion`` is q of `update` and its change.

        Sections that turn carry the displacement by ``loads`` along, so it is part of the rows.
        """
        rest_m, scratch = self.reduced.mesh.vertices_m, (self._load_n, self._residual_m)
        if gather_turned(self._places, points, loads, self._slot, scratch, self._corner_rows, (rest_m, motion[1]), out):
            return
        u = self._displace_corners(points, loads)
        rows, beyond_m = self._corner_rows[:u], self._residual_m[:u]
        self._frame.node_rows(self._corners.node[:u], beyond_m, rows)
        place_points(self._places, points, rows, (rest_m, beyond_m, motion[1]), out)

    def add_residual(self, points: Points, loads: Loads, out: tuple[FloatArray, FloatArray]) -> None:
        """Do as `PointCompliance.add_residual`."""
        u = self._displace_corners(points, loads)
        apply_corner_displacements(points[1], self._corners.address, u, out)

    def _displace_corners(self, points: Points, loads: Loads) -> int:
        """Do as `displace_turned`, whether the corners have places or not."""
        scratch = self._load_n, self._residual_m
        u = int(displace_turned(self._places, points, loads, self._slot, scratch))
        if u >= 0:
            return u
        touched, u = self._corners, -1 - u
        corner, moved_m = touched.node[:u], self._residual_m[:u]
        along_wall = loads[0], self._load_n[: len(loads[0])]
        if not self._kept.displace_corners(points, along_wall, corner, moved_m):
            moved_m[:] = 0.0
            apply(self.reduced.residual.store.address, *along_wall, corner, moved_m)
        self._frame.turn_vectors(corner, moved_m, touched.displacement_m[:u])
        return u

    def compliance(self, points: Points, rows: FloatArray, gain: FloatArray, out: FloatArray, first: int = 0) -> int:
        """Do as `PointCompliance.compliance`."""
        source, rotations = self._source[: len(points[0])], self._rotations[: points[0].size]
        if not weigh_turned(self._places, points, source, rotations, out, first):
            self.compliance_uncached(points, rows, gain, out)
            return 0
        add_modal_compliance(rows, gain, self._scaled_modes, out, source, first)
        copy_coincident(source, out, first)
        return first

    def position_function(self, nodes: IntArray) -> Callable[[FloatArray], FloatArray]:
        """Return a function for the positions (k, 3) in m of ``nodes`` (k,) without contact loads, as last updated."""
        frame, none_m = self._frame, np.zeros((len(nodes), 3))

        def places(_q: FloatArray) -> FloatArray:
            frame.node_positions(nodes, none_m, at := np.empty_like(none_m))
            return at

        return places


def wall_motion(reduced: ReducedDuct, n_points: int) -> StraightMotion | TurnedMotion:
    """Return the motion model of a duct for up to ``n_points`` contact points."""
    return StraightMotion(reduced, n_points) if reduced.warp is None else TurnedMotion(reduced, reduced.warp, n_points)
