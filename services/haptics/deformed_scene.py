"""The deformed scene as haptics knows it: the newest duct and catheter, placed only where a tool comes near."""

from __future__ import annotations

import numpy as np

from protocol.arrays import pack
from protocol.bodies import Catheter, Duct
from services.mechanics.arrays import IntArray
from services.mechanics.bodies.wall import make_wall
from services.mechanics.collision import ToolContactDetector
from services.mechanics.compiled import kernel
from services.mechanics.reduction.reduced_duct import ReducedDuct
from services.mechanics.scene import SceneModel


class DeformedScene:
    """Read-only copy of what physics simulates.

    Attributes
    ----------
    surface
        The duct's wall, for collision detection.
    particles_m : (n, 3) float64
        The catheter's particles.
    refused
        Frames that do not fit this scene, by what was wrong.
    """

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        self._wall = make_wall(duct, 0.5 * scene.duct.thickness_m)
        self.surface = self._wall.surface
        self.particles_m = np.zeros((scene.catheter.n_segments + 1, 3))
        self.has_catheter = False
        self.refused: dict[str, int] = {}
        self._duct = duct
        self._max_loads = 3 * scene.contact.capacity
        self._catheter_radius_m = 0.5 * scene.catheter.outer_diameter_m
        self._margin_m = scene.contact.margin_m

    def take_duct(self, body: Duct) -> None:
        """Deform the wall as `body` says, if its basis is ours and its loads are on nodes that exist."""
        basis = self._duct.basis
        q, nodes, forces = body.q.view(), body.load_node.view(), body.load_force_n.view()
        if body.basis_hash != basis.content_hash or q.shape != (basis.n_modes,):
            self._refuse("basis")
        elif nodes.size > self._max_loads or not nodes_are_there(nodes, basis.n_nodes):
            self._refuse("load_node")
        else:
            self._wall.update(q, nodes, forces)

    def take_catheter(self, body: Catheter) -> None:
        """Take over the particles of `body`, if there are as many as in this scene."""
        positions = body.position_m.view()
        if positions.shape != self.particles_m.shape:
            self._refuse("particles")
            return
        self.particles_m[:] = positions
        self.has_catheter = True

    def remembers(self) -> object:
        """Return what remembers the wall, for whoever puts it back."""
        return self._wall

    def tool_detector(self) -> ToolContactDetector:
        """Return collision detection of the tools with this wall and catheter."""
        n_particles = self.particles_m.shape[0]
        return ToolContactDetector(self.surface, n_particles, self._catheter_radius_m, self._margin_m)

    def warm_up(self) -> None:
        """Compile what `take_duct` calls, for arrays of the wire: read-only ones are another type to the compiler."""
        q, nodes, forces = np.zeros(self._duct.basis.n_modes), np.zeros(1, np.int32), np.zeros((1, 3))
        nodes_are_there(pack(nodes, "<i4").view(), 1)
        self._wall.update(pack(q).view(), pack(nodes, "<i4").view(), pack(forces).view())

    def _refuse(self, what: str) -> None:
        self.refused[what] = self.refused.get(what, 0) + 1


@kernel
def nodes_are_there(nodes: IntArray, n_nodes: int) -> bool:
    """Return whether all of `nodes` are among the first ``n_nodes``."""
    there = True
    for node in nodes:
        there = there and 0 <= node < n_nodes
    return there
