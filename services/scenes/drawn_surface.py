"""The duct's surface from the modal coordinates on the bus: all of it, thirty times a second or more."""

from __future__ import annotations

import numpy as np

import trocar.protocol.bodies as bodies
from trocar.protocol.arrays import pack
from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame


class DrawnSurface:
    """Node positions ``X + Phi q + R f`` of one reduced duct, or those of its turned cross-sections.

    Attributes:
        points_m: (n, 3) float32. Of the last update; at rest before the first.

    Args:
        duct: What moves. The residual compliance takes most of an update, 1.6 ms for 5,000 nodes and 24 loads.
    """

    def __init__(self, duct: ReducedDuct) -> None:
        self.duct = duct
        self.rest_m: FloatArray = duct.mesh.vertices_m
        self.points_m: Float32Array = self.rest_m.astype(np.float32)
        self._frame = None if duct.warp is None else SectionFrame(duct.warp)
        self._every_node = np.arange(duct.basis.n_nodes, dtype=np.int32)

    def warm_up(self) -> None:
        """Compile what an update calls, with a load: who compiles in its loop is silent, or loses frames."""
        basis = self.duct.basis
        q, nodes, forces_n = np.zeros(basis.n_modes), np.zeros(1, np.int32), np.zeros((1, 3))
        load = {"load_node": pack(nodes, "<i4"), "load_force_n": pack(forces_n)}
        self.update(bodies.Duct(basis_hash=basis.content_hash, q=pack(q), q_rate=pack(q), **load))

    def update(self, body: bodies.Duct) -> bool:
        """Rebuild `points_m`; return False, with the points as they were, if the body does not fit the duct."""
        q, nodes, forces_n = body.q.view(), body.load_node.view(), body.load_force_n.view()
        basis = self.duct.basis
        if body.basis_hash != basis.content_hash or len(q) > basis.n_modes:
            return False
        if len(nodes) and not 0 <= nodes.min() <= nodes.max() < basis.n_nodes:
            return False
        if self._frame is None:
            points = self.rest_m + self.duct.displacements(q, nodes, forces_n)
        else:
            points = self._turned(self._frame, q, nodes, forces_n)
        self.points_m = points.astype(np.float32)
        return True

    def _turned(
        self,
        frame: SectionFrame,
        q: FloatArray,
        nodes: IntArray,
        forces_n: FloatArray,
    ) -> FloatArray:
        frame.update(np.pad(q, (0, self.duct.basis.n_modes - len(q))))
        along_wall_n = np.empty((len(nodes), 3))
        carried, points = np.zeros_like(self.rest_m), np.empty_like(self.rest_m)
        frame.turn_back(nodes, forces_n, along_wall_n)
        self.duct.residual.apply(nodes, along_wall_n, self._every_node, carried)
        frame.node_positions(self._every_node, carried, points)
        return points
