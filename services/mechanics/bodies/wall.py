"""The wall as collision detection meets it: modes, residual displacement round the loads, turned sections if any."""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision import CollisionSurface
from services.mechanics.reduction import ReducedDuct
from services.mechanics.reduction.large_rotations.warping import SectionFrame
from services.mechanics.reduction.residual.field import ResidualField


class Wall:
    """Surface of a reduced duct, moved by what a duct frame holds. Physics and haptics see the same one.

    Attributes
    ----------
    surface : CollisionSurface
    """

    def __init__(self, duct: ReducedDuct, half_thickness_m: float) -> None:
        basis = duct.basis
        self.surface = CollisionSurface(duct.mesh, basis.Phi, basis.omega_rad_s, half_thickness_m, duct.warp)
        self._residual = ResidualField(duct)

    def update(self, q: FloatArray, load_nodes: IntArray, load_force_n: FloatArray) -> None:
        """Take modal coordinates (r,) and the contact loads (l,), (l, 3) along world axes, each node once."""
        residual = self._residual
        residual.update(load_nodes, load_force_n)
        self.surface.update(q, residual.nodes[: residual.count], residual.displacement_m[: residual.count])


class TurnedWall(Wall):
    """Wall whose sections turn: the loads are turned back into the undeformed axes, where the residual is known."""

    def __init__(self, duct: ReducedDuct, half_thickness_m: float) -> None:
        super().__init__(duct, half_thickness_m)
        if duct.warp is None:
            raise ValueError("a wall that turns needs a duct with a warp")
        self._frame = SectionFrame(duct.warp)
        self._load_n = np.zeros((duct.mesh.n_vertices, 3))

    def update(self, q: FloatArray, load_nodes: IntArray, load_force_n: FloatArray) -> None:
        """Take modal coordinates (r,) and the contact loads (l,), (l, 3) along world axes, each node once."""
        loads = self._load_n[: len(load_nodes)]
        self._frame.update(q)
        self._frame.turn_back(load_nodes, load_force_n, loads)
        super().update(q, load_nodes, loads)


def make_wall(duct: ReducedDuct, half_thickness_m: float) -> Wall:
    """Return the wall of a duct, turned where the duct has a warp."""
    kind = Wall if duct.warp is None else TurnedWall
    return kind(duct, half_thickness_m)
