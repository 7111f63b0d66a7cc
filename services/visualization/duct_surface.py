"""The duct's surface from the modal coordinates on the bus: all of it, thirty times a second or more."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import protocol.bodies as bodies
from services.mechanics.reduction import ReducedDuct
from services.visualization.picture import FloatArray


class DuctSurface:
    """Node positions ``X + Phi q + R f`` of one reduced duct.

    Attributes
    ----------
    points_m : (n, 3) float32
        Of the last update; at rest before the first.
    """

    def __init__(self, duct: ReducedDuct) -> None:
        self.duct = duct
        self.rest_m: npt.NDArray[np.float64] = duct.mesh.vertices_m
        self.points_m: FloatArray = self.rest_m.astype(np.float32)
        self._modes = duct.basis.Phi.reshape(-1, duct.basis.n_modes)
        self._every_node = np.arange(duct.basis.n_nodes, dtype=np.int32)

    def update(self, body: bodies.Duct) -> bool:
        """Rebuild `points_m`; return False, with the points as they were, if the body does not fit the duct."""
        q, nodes = body.q.view(), body.load_node.view()
        basis = self.duct.basis
        if body.basis_hash != basis.content_hash or len(q) > basis.n_modes:
            return False
        if len(nodes) and not 0 <= nodes.min() <= nodes.max() < basis.n_nodes:
            return False
        modes = self._modes if len(q) == self._modes.shape[1] else self._modes[:, : len(q)]
        displacement = (modes @ q).reshape(-1, 3)
        if len(nodes):
            self.duct.residual.apply(nodes, body.load_force_n.view(), self._every_node, displacement)
        self.points_m = (self.rest_m + displacement).astype(np.float32)
        return True
