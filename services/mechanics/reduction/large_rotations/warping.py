"""Large rotations of a reduced tube: its cross-sections are turned and strung together again.

A linear mode moves every node along a straight line, so a duct bent far grows longer and thicker. Here each
cross-section's turn and the strain between neighbouring sections are read off the linear field; the sections are
then turned by finite rotations and the axis is integrated anew, carrying the rest of the linear field (pinch,
ovalling) along in the turned frame. It is a geometrically exact beam whose sections deform, and to first order it
is the linear field itself. docs/decisions/large-rotations.md says why not modal warping.

With kappa linear in q, the linear modal energy is that of a Reissner beam: loads that act through the Jacobian
dx/dq reproduce large deflections of equilibrium too, not only of shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.large_rotations.sections import Sections, cut_sections
from trocar.services.mechanics.reduction.large_rotations.warping_kernels import (
    WarpedTube,
    node_positions,
    node_rotations,
    node_rows,
    turn_vectors,
    update_axis,
)
from trocar.services.mechanics.surface.mesh import TriangleMesh


@dataclass(frozen=True, slots=True)
class TubeWarp:
    """What warping needs of a duct, prepared once.

    Attributes:
        sections: Sections. Stations along the axis.
        turn: (s + 1, 3, r) float64. Rotation vector of each station per modal coordinate.
        stretch: (s, 3, r) float64. Change of the axis between stations, in their frame, per modal coordinate: strain
            times length.
        arm_m: (n, 3) float64. Each node from its point of the axis.
        local: (n, 3, r) float64. What is left of the modes when the sections' rigid motion is taken off.
    """

    sections: Sections
    turn: FloatArray
    stretch: FloatArray
    arm_m: FloatArray
    local: FloatArray

    @classmethod
    def from_basis(cls, mesh: TriangleMesh, basis: ModalBasis, held: IntArray, n_segments: int = 24) -> TubeWarp:
        """Fit the sections' rigid motion to every mode by area-weighted least squares; none at the held end."""
        sections = cut_sections(mesh, held, n_segments)
        shift, turn = _section_motion(mesh, basis, sections)
        axis_m = np.diff(sections.centres_m, axis=0)
        middle_turn = 0.5 * (turn[:-1] + turn[1:])
        stretch = np.diff(shift, axis=0) - np.cross(middle_turn, axis_m[:, :, None], axis=1)
        shares = sections.shares()
        arm = mesh.vertices_m - np.asarray(shares @ sections.centres_m)
        rigid = _spread(shares, shift) + np.cross(_spread(shares, turn), arm[:, :, None], axis=1)
        return cls(sections, turn, np.ascontiguousarray(stretch), arm, np.ascontiguousarray(basis.Phi - rigid))


def warped_tube(warp: TubeWarp | None, n_modes: int) -> WarpedTube:
    """Return the tube at rest for the kernels; without a warp, one without stations."""
    if warp is None:
        return WarpedTube.zeros(**{"s": 0, "s - 1": 0, "n": 0, "r": n_modes})
    sections = warp.sections
    tube: WarpedTube = WarpedTube.zeros(
        s=len(warp.turn),
        r=n_modes,
        rest_centre=sections.centres_m,
        turn_modes=warp.turn,
        stretch_modes=warp.stretch,
        segment=sections.segment,
        fraction=sections.fraction,
        arm=warp.arm_m,
        local=warp.local,
    )
    rest = tube.q.copy()
    tube.q[:] = np.nan  # of no state yet
    update_axis(tube.address, rest)
    return tube


class SectionFrame:
    """The warped axis at one state: updated once a tick, then read at a few nodes. Nothing is allocated.

    Cost: a few microseconds for the axis, less than one a node, whatever the size of the mesh. Derivatives of the
    axis cost some ten times as much and are made when rows are first asked for in a state.
    """

    def __init__(self, warp: TubeWarp) -> None:
        self._tube = warped_tube(warp, warp.turn.shape[2])

    @property
    def address(self) -> Address[WarpedTube]:
        """The axis for kernels."""
        return self._tube.address

    @property
    def centres_m(self) -> FloatArray:
        """Points of the axis (s + 1, 3) in this state; a live view."""
        return self._tube.centre

    @property
    def turns(self) -> FloatArray:
        """Rotation vectors of the stations (s + 1, 3) in this state; a live view."""
        return self._tube.turn

    def update(self, q: FloatArray) -> None:
        """Integrate the axis for modal coordinates q (r,)."""
        update_axis(self._tube.address, q)

    def node_positions(self, nodes: IntArray, extra_m: FloatArray, out: FloatArray) -> None:
        """Write the positions of ``nodes`` (k,) into ``out`` (k, 3), in m.

        ``extra_m`` (k, 3) is a displacement in the undeformed axes that is carried along, such as the residual
        compliance's.
        """
        node_positions(self._tube.address, nodes, extra_m, out)

    def node_rows(self, nodes: IntArray, extra_m: FloatArray, out: FloatArray) -> None:
        """Write d position / d q of ``nodes`` (k,) into ``out`` (k, 3, r): it takes the place of Phi.

        ``extra_m`` (k, 3) is as for `node_positions`: a section that turns moves what it carries along.
        """
        node_rows(self._tube.address, nodes, extra_m, out)

    def turn_vectors(self, nodes: IntArray, vectors: FloatArray, out: FloatArray) -> None:
        """Turn ``vectors`` (k, 3) of ``nodes`` (k,) from undeformed into world axes; ``out`` (k, 3) may be the same."""
        turn_vectors(self._tube.address, nodes, False, vectors, out)

    def turn_back(self, nodes: IntArray, vectors: FloatArray, out: FloatArray) -> None:
        """Turn ``vectors`` (k, 3) of ``nodes`` (k,) from world into undeformed axes; ``out`` (k, 3) may be the same."""
        turn_vectors(self._tube.address, nodes, True, vectors, out)

    def node_rotations(self, nodes: IntArray, out: FloatArray) -> None:
        """Write the rotations of the sections of ``nodes`` (k,) into ``out`` (k, 3, 3)."""
        node_rotations(self._tube.address, nodes, out)


def _section_motion(mesh: TriangleMesh, basis: ModalBasis, sections: Sections) -> tuple[FloatArray, FloatArray]:
    """Return shift and turn (s + 1, 3, r) of each station per modal coordinate, zero at the first."""
    r, n_stations = basis.n_modes, sections.n_stations
    shift, turn = np.zeros((2, n_stations, 3, r))
    for station, (nodes, weight, arm, inertia_m2) in enumerate(sections.rings(mesh), 1):
        shift[station] = np.einsum("k,kir->ir", weight, basis.Phi[nodes])
        moment = np.einsum("k,kir->ir", weight, np.cross(arm[:, :, None], basis.Phi[nodes], axis=1))
        turn[station] = np.linalg.solve(inertia_m2, moment)
    return shift, turn


def _spread(shares: scipy.sparse.csc_array, stations: FloatArray) -> FloatArray:
    """Interpolate (s + 1, 3, r) at stations to (n, 3, r) at nodes."""
    flat = np.asarray(shares @ stations.reshape(len(stations), -1))
    return flat.reshape(-1, *stations.shape[1:])
