"""What the simulation asks of collision detection, and the detection that answers unless a scene brings its own."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from services.mechanics.arrays import AnyArray, FloatArray, IntArray
from services.mechanics.bodies.catheter import CatheterBody
from services.mechanics.bodies.duct import DuctBody
from services.mechanics.bodies.forceps.tool_body import ToolBody
from services.mechanics.bodies.wall import make_wall
from services.mechanics.collision import CatheterContactDetector, ToolContactDetector
from services.mechanics.collision.pairs import CATHETER_SEGMENT, ContactPairs
from services.mechanics.compiled.memory import copy_arrays, copy_table
from services.mechanics.contact.met import NEARLY_MET_M
from services.mechanics.reduction import ReducedDuct
from services.mechanics.scene import SceneModel
from services.mechanics.scene.tools import N_TOOLS


class SphereDetector(Protocol):
    """Finds where one sphere meets the wall, from tick to tick."""

    def detect(self, centre_m: FloatArray, pairs: ContactPairs, ahead_m: FloatArray) -> None:
        """Append the pairs of a sphere at ``centre_m`` (1, 3), in the place of the catheter's particle 0.

        ``ahead_m`` (1, 3) is how far it may go in the step.
        """


class ContactSearch(Protocol):
    """Finds candidate pairs from positions at the start of the step."""

    @property
    def inside(self) -> npt.NDArray[np.int8]:
        """(n,) one where a particle of the catheter is in the lumen."""

    @property
    def against_m(self) -> FloatArray:
        """(n, 2, 3) how far its particles went in the last step against the walls that they were closest to."""

    def start(self, duct: DuctBody) -> None:
        """Take over the duct's shape at the start of the step."""

    def node_positions(self, nodes: IntArray, out: FloatArray) -> None:
        """Write where ``nodes`` (k,) of the wall are into ``out`` (k, 3), in m."""

    def catheter_pairs(self, catheter: CatheterBody, pairs: ContactPairs) -> None:
        """Append those of the catheter against the duct."""

    def tool_pairs(self, catheter: CatheterBody, tools: ToolBody, pairs: ContactPairs) -> None:
        """Append those of the tools against duct and catheter."""

    def take_up_tools(self, catheter: CatheterBody, tools: ToolBody, pairs: ContactPairs) -> None:
        """Do as `tool_pairs`, from where the tools are alone: somebody else has looked for their pairs of late."""

    def end_pairs(self, duct: DuctBody, catheter: CatheterBody, tools: ToolBody, pairs: ContactPairs) -> None:
        """Append those of catheter and tools where the bodies are now, at the end of the step; remember nothing of it.

        The wall stays there until the next `start`.
        """

    def sphere_detector(self, radius_m: float) -> SphereDetector:
        """Return what finds the contacts of one more sphere with the wall."""

    def is_sound(self) -> bool:
        """Return whether the catheter goes into the lumen by openings only, as last detected."""

    def state_arrays(self) -> list[AnyArray]:
        """Return the live arrays of what the search remembers."""


class DuctSearch:
    """Collision detection of `services.mechanics.collision` on the reduced duct."""

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        half_thickness_m = 0.5 * scene.duct.thickness_m
        self._margin_m = margin_m = scene.contact.margin_m
        radius_m = 0.5 * scene.catheter.outer_diameter_m
        self._wall = make_wall(duct, half_thickness_m)
        self.surface = self._wall.surface
        self._had_tools = True
        n_particles = scene.catheter.n_segments + 1
        self.catheter = CatheterContactDetector(self.surface, n_particles, radius_m, margin_m)
        self._spheres: list[CatheterContactDetector] = []
        self.tools = ToolContactDetector(self.surface, n_particles, radius_m, margin_m)
        memory = [*self.catheter.state_arrays(), *self.tools.state_arrays()]
        self._past = [array.copy() for array in memory]
        self._keep_past, self._go_back = copy_table(self._past, memory), copy_table(memory, self._past)

    @property
    def inside(self) -> npt.NDArray[np.int8]:
        """(n,) one where a particle of the catheter is in the lumen; a live view."""
        return self.catheter.inside

    @property
    def against_m(self) -> FloatArray:
        """(n, 2, 3) how far its particles went against the walls that they were closest to; a live view."""
        return self.catheter.against_m

    def start(self, duct: DuctBody) -> None:
        """Move the wall."""
        self._wall.follow(duct)

    def node_positions(self, nodes: IntArray, out: FloatArray) -> None:
        """Write where ``nodes`` (k,) of the wall are into ``out`` (k, 3), in m."""
        self.surface.node_positions(nodes, out)

    def catheter_pairs(self, catheter: CatheterBody, pairs: ContactPairs) -> None:
        """Append those of the catheter against the duct."""
        self.catheter.detect(catheter.start_m, pairs, catheter.motion_m)

    def sphere_detector(self, radius_m: float) -> CatheterContactDetector:
        """Return what finds the contacts of one more sphere with the wall."""
        self._spheres.append(CatheterContactDetector(self.surface, 1, radius_m, self._margin_m))
        return self._spheres[-1]

    def is_sound(self) -> bool:
        """Return whether the catheter goes into the lumen by openings only, as last detected."""
        return self.catheter.enters_by_openings()

    def state_arrays(self) -> list[AnyArray]:
        """Return the live arrays of what the search remembers."""
        spheres = [array for sphere in self._spheres for array in sphere.state_arrays()]
        return [*self.catheter.state_arrays(), *self.tools.state_arrays(), *spheres]

    def tool_pairs(self, catheter: CatheterBody, tools: ToolBody, pairs: ContactPairs) -> None:
        """Append those of the tools against duct and catheter."""
        present = bool(tools.present.any())
        if tools.have_come:
            for tool in np.flatnonzero(tools.waiting):
                self.tools.look_afresh(int(tool))
        # An absent tool has to be told once, so that it loses its past.
        if present or self._had_tools:
            self._detect_tools(catheter.start_m, tools, pairs)
        self._had_tools = present

    def take_up_tools(self, catheter: CatheterBody, tools: ToolBody, pairs: ContactPairs) -> None:
        """Do as `tool_pairs`, from where the tools are alone: somebody else has looked for their pairs of late."""
        self.tools.take_up(tools.segments, tools.radius_m)
        self._had_tools = True
        self.tool_pairs(catheter, tools, pairs)
        self.tools.stand_still()

    def end_pairs(self, duct: DuctBody, catheter: CatheterBody, tools: ToolBody, pairs: ContactPairs) -> None:
        """Append those of catheter and tools where the bodies are now, at the end of the step; remember nothing of it.

        The wall stays there until the next `start`.
        """
        copy_arrays(self._keep_past)
        self._wall.follow(duct, to_end=True)
        if self._had_tools:
            with self.tools.all_within(NEARLY_MET_M):
                self._detect_tools(catheter.state.position_m, tools, pairs)
        self.catheter.detect(catheter.state.position_m, pairs)
        copy_arrays(self._go_back)

    def _detect_tools(self, particles_m: FloatArray, tools: ToolBody, pairs: ContactPairs) -> None:
        for tool in range(N_TOOLS):
            if tools.held[tool, CATHETER_SEGMENT]:
                self.tools.let_through(tool)
        self.tools.detect(tools.segments, tools.radius_m, particles_m, pairs, tools.present)
