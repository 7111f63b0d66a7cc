"""The names that `trocar` makes public, and what they stand for: imported when the first of them is used."""

from __future__ import annotations

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.bodies.forceps.tool_body import ToolBody
from trocar.services.mechanics.collision.pairs import ContactPairs
from trocar.services.mechanics.contact.candidate_search import CandidateSearch
from trocar.services.mechanics.contact.holds import HoldRegistry
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.seal import IntroducerSeal
from trocar.services.mechanics.contact.squeeze import JawSqueeze
from trocar.services.mechanics.contact.system import ContactSystem, DroppedContacts
from trocar.services.mechanics.effects import EFFECTS, Effect, EffectEntry
from trocar.services.mechanics.fem.section import ShellSection
from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.rod.properties import RodProperties
from trocar.services.mechanics.scenarios import PlayedScene as Motion
from trocar.services.mechanics.scenarios import ToolMotion
from trocar.services.mechanics.scene import (
    CatheterScene,
    ContactSettings,
    DuctScene,
    ForcepsScene,
    ProbeScene,
    QualityLevel,
)
from trocar.services.mechanics.scene import SceneModel as Scene
from trocar.services.mechanics.scene.air_bubble import AirBubble
from trocar.services.mechanics.scene.catheter_section import CatheterSection
from trocar.services.mechanics.scene.cystic_duct import CysticDuctScene
from trocar.services.mechanics.scene.duct_branch import DuctBranch
from trocar.services.mechanics.scene.guide_wire import GuideWireScene
from trocar.services.mechanics.scene.incision import IncisionScene
from trocar.services.mechanics.scene.instruments.tool import DrawnPart, ToolScene
from trocar.services.mechanics.scene.tools import GraspHold
from trocar.services.mechanics.scene.tools import ToolInputs as Hands
from trocar.services.mechanics.scene.tools import ToolResults as HandResults
from trocar.services.mechanics.scene.wall_bar import WallBar
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.world import RestartablePart, World, WorldEffect
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import hands_of


def simulate(scene: Scene, progress: Progress = ignore_progress) -> Simulation:
    """Return a simulation of a scene at rest; its duct is computed once and then cached.

    Raises ConfigError: one sentence, if the duct of the scene is invalid.

    Args:
        scene: Scene. From `load_scene`, or constructed from its parts.
        progress: callable, optional. Called with the name of each part of the work and its completed fraction, 0 to 1.
    """
    return Simulation(scene, load_duct(scene, cache_directory(), progress))


def wall_m(simulation: Simulation) -> FloatArray:
    """Return the present positions (n, 3) of the duct's middle surface's nodes, in scene axes."""
    duct, n = simulation.duct.reduced, simulation.duct.n_loads
    loads = simulation.duct.load_nodes[:n], simulation.duct.load_force_n[:n]
    moved_m: FloatArray = duct.mesh.vertices_m + duct.displacements(simulation.duct.state.q, *loads)
    return moved_m


def tip_m(simulation: Simulation) -> FloatArray:
    """Return a copy of the position (3,) of the catheter's tip, in scene axes."""
    end_m: FloatArray = simulation.catheter.state.position_m[-1]
    return end_m.copy()


def expert(simulation: Simulation) -> Motion:
    """Return the motion of an expert's hands; ``write_inputs(time_s, hands)`` writes it for ``duration_s``."""
    return hands_of(simulation.scene, simulation.duct.reduced.mesh)


def add_effect(name: str, kind: type[Effect], what: str) -> None:
    """Register an effect of your own for the scenes of this process; it acts after all others.

    Raises ValueError if there is an effect of this name.
    """
    if name in EFFECTS:
        raise ValueError(f"there is an effect {name!r} already: {EFFECTS[name].what}")
    EFFECTS[name] = EffectEntry(kind, what)


#: Classes that are public because signatures of the others name them: to be annotated with and asked of, not made.
NAMED_ONLY = frozenset(
    {
        "CandidateSearch",
        "CatheterBody",
        "CatheterSection",
        "ContactPairs",
        "ContactRows",
        "ContactSystem",
        "DrawnPart",
        "DroppedContacts",
        "DuctBody",
        "CysticDuctScene",
        "DuctBranch",
        "AirBubble",
        "GuideWireScene",
        "HoldRegistry",
        "IncisionScene",
        "IntroducerSeal",
        "JawSqueeze",
        "ReducedDuct",
        "RestartablePart",
        "RodProperties",
        "ShellSection",
        "ToolBody",
        "ToolMotion",
        "ToolScene",
        "TriangleMesh",
        "WallBar",
        "WorldEffect",
    }
)

__all__ = [
    "AirBubble",
    "CandidateSearch",
    "CatheterBody",
    "CatheterScene",
    "CatheterSection",
    "ConfigError",
    "ContactPairs",
    "ContactRows",
    "ContactSettings",
    "ContactSystem",
    "CysticDuctScene",
    "DrawnPart",
    "DroppedContacts",
    "DuctBody",
    "DuctBranch",
    "DuctScene",
    "Effect",
    "ForcepsScene",
    "GraspHold",
    "GuideWireScene",
    "HandResults",
    "Hands",
    "HoldRegistry",
    "IncisionScene",
    "IntroducerSeal",
    "JawSqueeze",
    "Motion",
    "ProbeScene",
    "QualityLevel",
    "ReducedDuct",
    "RestartablePart",
    "RodProperties",
    "Scene",
    "ShellSection",
    "Simulation",
    "ToolBody",
    "ToolMotion",
    "ToolScene",
    "TriangleMesh",
    "WallBar",
    "World",
    "WorldEffect",
    "add_effect",
    "expert",
    "load_scene",
    "simulate",
    "tip_m",
    "wall_m",
]
