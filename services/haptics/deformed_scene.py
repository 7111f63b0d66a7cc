"""The deformed scene in haptics: the newest duct and catheter, used only where jaws close."""

from __future__ import annotations

import numpy as np

from trocar.protocol.arrays import pack
from trocar.protocol.bodies import Catheter, Duct
from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.collision.placed_wall import Loads
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel


class DeformedScene:
    """Read-only copy of the state of physics.

    Attributes:
        q: (r,) float64. The duct's coordinates.
        loads: (l,) int32 and (l, 3) float64. Its loaded nodes and the forces on them in N.
        particles_m: (n, 3) float64. The catheter's particles.
        has_catheter: Whether a catheter has been received.
        refused: Number of frames that do not fit this scene, by reason.
    """

    q: FloatArray
    loads: Loads

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        self.particles_m = np.zeros((scene.catheter.n_rod_segments + 1, 3))
        self.refused: dict[str, int] = {}
        self._basis = duct.basis
        self._max_loads = 3 * scene.contact.capacity
        self.forget()

    def forget(self) -> None:
        """Reset to a duct at rest without a catheter."""
        # Read-only like arrays off the wire, as the compiler treats that as another type.
        self.q = pack(np.zeros(self._basis.n_modes)).view()
        self.loads = pack(np.zeros(0), "<i4").view(), pack(np.zeros((0, 3))).view()
        self.has_catheter = False

    def take_duct(self, body: Duct) -> None:
        """Store coordinates and loads of `body`, if its basis is this scene's and its nodes exist."""
        basis = self._basis
        q, nodes, forces = body.q.view(), body.load_node.view(), body.load_force_n.view()
        if body.basis_hash != basis.content_hash or q.shape != (basis.n_modes,):
            self._refuse("basis")
        elif nodes.size > self._max_loads or not nodes_exist(nodes, basis.n_nodes):
            self._refuse("load_node")
        else:
            self.q, self.loads = q, (nodes, forces)

    def take_catheter(self, body: Catheter) -> None:
        """Store the particles of `body`, if their number is this scene's."""
        positions = body.position_m.view()
        if positions.shape != self.particles_m.shape:
            self._refuse("particles")
            return
        self.particles_m[:] = positions
        self.has_catheter = True

    def _refuse(self, what: str) -> None:
        self.refused[what] = self.refused.get(what, 0) + 1


@kernel
def nodes_exist(nodes: IntArray, n_nodes: int) -> bool:
    """Return whether all of `nodes` are valid indices of ``n_nodes`` nodes."""
    there = True
    for node in nodes:
        there = there and 0 <= node < n_nodes
    return there
