"""Surface of the duct's wall for collision detection: modes, residual displacement near loads, turned sections."""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.bodies.duct import DuctBody
from services.mechanics.bodies.duct_loads import DuctLoads, loads_at
from services.mechanics.collision import CollisionSurface
from services.mechanics.collision.shell import Shell
from services.mechanics.collision.tick import start_tick
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.reduction import ReducedDuct
from services.mechanics.reduction.large_rotations.warping import SectionFrame
from services.mechanics.reduction.residual.residual_field import (
    FieldArrays,
    ResidualField,
    displace_round_loads,
    field_at,
)


class WallSurface:
    """Surface of a reduced duct, placed by its modal coordinates and contact loads; one for physics and haptics.

    Attributes
    ----------
    surface : CollisionSurface
    """

    def __init__(self, duct: ReducedDuct, half_thickness_m: float) -> None:
        basis = duct.basis
        self.surface = CollisionSurface(duct.mesh, basis.Phi, basis.omega_rad_s, half_thickness_m, duct.warp)
        self._residual = ResidualField(duct, 2.0 * half_thickness_m)

    def update(self, q: FloatArray, load_nodes: IntArray, load_force_n: FloatArray) -> None:
        """Take modal coordinates (r,) and the contact loads (l,), (l, 3) along world axes, each node once."""
        residual = self._residual
        residual.update(load_nodes, load_force_n)
        self.surface.update(q, residual.nodes[: residual.count], residual.displacement_m[: residual.count])

    def follow(self, duct: DuctBody, *, to_end: bool = False) -> None:
        """Take the state of a duct's body at the start of the step, or at its end as far as that is known."""
        if not move_wall(self._residual.address, self.surface.shell.address, duct.loads_address, to_end):
            raise ValueError("the duct's coordinates or contact loads are not finite")


class RotatedWallSurface(WallSurface):
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

    def follow(self, duct: DuctBody, *, to_end: bool = False) -> None:
        """Take the state of a duct's body at the start of the step, or at its end as far as that is known."""
        n = duct.n_loads
        self.update(duct.state.q if to_end else duct.q_start, duct.load_nodes[:n], duct.load_force_n[:n])


@kernel
def move_wall(
    field: Address[FieldArrays], shell: Address[Shell], duct_address: Address[DuctLoads], to_end: bool
) -> bool:
    """Move a straight wall to where a duct's body is, loads included; False, and not moved, where that is no number.

    ``to_end`` is where it is with the step's own forces, and not where the step began.
    """
    duct, arrays = loads_at(duct_address), field_at(field)
    n = duct.count[0]
    count = displace_round_loads(field, duct.node[:n], duct.force[:n])
    q = duct.free.q if to_end else duct.free.start
    return bool(start_tick(shell, q, arrays.node[:count], arrays.displacement[:count]))


def make_wall(duct: ReducedDuct, half_thickness_m: float) -> WallSurface:
    """Return the wall of a duct, turned where the duct has a warp."""
    kind = WallSurface if duct.warp is None else RotatedWallSurface
    return kind(duct, half_thickness_m)
