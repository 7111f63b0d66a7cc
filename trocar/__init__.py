"""Public interface of the library: a scene, its simulation, and the hands that act on it.

    import trocar

    simulation, hands = trocar.simulate(trocar.load_scene("insertion")), trocar.Hands()
    simulation.step(hands)

Names here are stable by the deprecation policy of `CONTRIBUTING.md`; `services` and `protocol` may change with every
release. Units are SI, arrays float64 unless stated otherwise, positions and forces in the axes of the scene.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trocar.front import AirBubble as AirBubble
    from trocar.front import CandidateSearch as CandidateSearch
    from trocar.front import CatheterBody as CatheterBody
    from trocar.front import CatheterScene as CatheterScene
    from trocar.front import CatheterSection as CatheterSection
    from trocar.front import ConfigError as ConfigError
    from trocar.front import ContactPairs as ContactPairs
    from trocar.front import ContactRows as ContactRows
    from trocar.front import ContactSettings as ContactSettings
    from trocar.front import ContactSystem as ContactSystem
    from trocar.front import CysticDuctScene as CysticDuctScene
    from trocar.front import DrawnPart as DrawnPart
    from trocar.front import DroppedContacts as DroppedContacts
    from trocar.front import DuctBody as DuctBody
    from trocar.front import DuctBranch as DuctBranch
    from trocar.front import DuctScene as DuctScene
    from trocar.front import Effect as Effect
    from trocar.front import ForcepsScene as ForcepsScene
    from trocar.front import GraspHold as GraspHold
    from trocar.front import GuideWireScene as GuideWireScene
    from trocar.front import HandResults as HandResults
    from trocar.front import Hands as Hands
    from trocar.front import HoldRegistry as HoldRegistry
    from trocar.front import IncisionScene as IncisionScene
    from trocar.front import IntroducerSeal as IntroducerSeal
    from trocar.front import JawSqueeze as JawSqueeze
    from trocar.front import Motion as Motion
    from trocar.front import ProbeScene as ProbeScene
    from trocar.front import QualityLevel as QualityLevel
    from trocar.front import ReducedDuct as ReducedDuct
    from trocar.front import RestartablePart as RestartablePart
    from trocar.front import RodProperties as RodProperties
    from trocar.front import Scene as Scene
    from trocar.front import ShellSection as ShellSection
    from trocar.front import Simulation as Simulation
    from trocar.front import ToolBody as ToolBody
    from trocar.front import ToolMotion as ToolMotion
    from trocar.front import ToolScene as ToolScene
    from trocar.front import TriangleMesh as TriangleMesh
    from trocar.front import WallBar as WallBar
    from trocar.front import World as World
    from trocar.front import WorldEffect as WorldEffect
    from trocar.front import add_effect as add_effect
    from trocar.front import expert as expert
    from trocar.front import load_scene as load_scene
    from trocar.front import simulate as simulate
    from trocar.front import tip_m as tip_m
    from trocar.front import wall_m as wall_m

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


def __getattr__(name: str) -> object:
    """Return a public name: with the first one the library is imported, which takes a second."""
    if name not in __all__:
        raise AttributeError(f"module 'trocar' has no attribute {name!r}")
    return getattr(import_module("trocar.front"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
