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
    from trocar.front import CatheterScene as CatheterScene
    from trocar.front import ConfigError as ConfigError
    from trocar.front import ContactSettings as ContactSettings
    from trocar.front import DuctScene as DuctScene
    from trocar.front import Effect as Effect
    from trocar.front import ForcepsScene as ForcepsScene
    from trocar.front import GraspHold as GraspHold
    from trocar.front import HandResults as HandResults
    from trocar.front import Hands as Hands
    from trocar.front import Motion as Motion
    from trocar.front import ProbeScene as ProbeScene
    from trocar.front import QualityLevel as QualityLevel
    from trocar.front import Scene as Scene
    from trocar.front import Simulation as Simulation
    from trocar.front import World as World
    from trocar.front import add_effect as add_effect
    from trocar.front import expert as expert
    from trocar.front import load_scene as load_scene
    from trocar.front import simulate as simulate
    from trocar.front import tip_m as tip_m
    from trocar.front import wall_m as wall_m

__all__ = [
    "CatheterScene",
    "ConfigError",
    "ContactSettings",
    "DuctScene",
    "Effect",
    "ForcepsScene",
    "GraspHold",
    "HandResults",
    "Hands",
    "Motion",
    "ProbeScene",
    "QualityLevel",
    "Scene",
    "Simulation",
    "World",
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
