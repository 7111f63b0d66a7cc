"""The scene of an episode at rest: rebuilt if it differs from the last one, otherwise reset."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trocar.envs.grips import Grips
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.reduction.build import ignore_progress
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.snapshot import Snapshot
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.duct_file import duct_file
from trocar.services.training.site import Site, read_site


class Stage:
    """A scene that is reset for each episode.

    Args:
        name, overrides: The scene, as for `trocar.load_scene`.
        quality: int, optional. Quality level of the scene; None for the last.

    Attributes:
        simulation: Simulation. At rest after `begin`.
        grips: Grips. Grasps of its tools.
        site: Site. Site of the duct, as read from a recording.
        ways: TubePaths. Paths from its mouth to its ends.
    """

    def __init__(self, name: str | Path, overrides: tuple[str, ...] = (), quality: int | None = None) -> None:
        self.name, self._overrides, self._quality = name, overrides, quality
        self._wall: tuple[object, ...] = ()
        self._drawn: tuple[str, ...] | None = None
        self.begin()

    @property
    def overrides(self) -> tuple[str, ...]:
        """Present overrides of the scene."""
        return (*self._overrides, *(self._drawn or ()))

    def begin(self, drawn: tuple[str, ...] = ()) -> Simulation:
        """Return the simulation at rest, with ``drawn`` as further overrides.

        Raises ConfigError: one sentence, if the scene is invalid.
        """
        if drawn != self._drawn:
            self._build(drawn)
        else:
            self._snapshot.restore()
            self.simulation.set_quality(self.level)
            self.grips.begin_again()
        return self.simulation

    def _build(self, drawn: tuple[str, ...]) -> None:
        scene = load_scene(self.name, (*self._overrides, *drawn))
        self.level = len(scene.quality) - 1 if self._quality is None else self._quality
        if not 0 <= self.level < len(scene.quality):
            raise ConfigError(f"quality: scene {self.name} has rungs 0 to {len(scene.quality) - 1}, not {self.level}")
        wall = scene.duct, scene.effects
        if wall != self._wall:
            self.duct = _load(scene)
            self._attached = duct_file(self.duct)
            self.site, self._wall = _site(self._attached), wall
            self.ways = TubePaths({name: np.array(way) for name, way in self.site.ways.items()})
        self.scene, self._drawn = scene, drawn
        self.simulation = Simulation(scene, self.duct)
        self._snapshot = Snapshot(
            self.simulation, (scene, self.simulation.scene, self.duct, self.simulation.duct.reduced)
        )
        self.simulation.set_quality(self.level)
        self.grips = Grips(self.simulation.scene, self.duct)

    @property
    def duct_file(self) -> bytes:
        """The duct's attachment of a recording."""
        return self._attached


def _load(scene: SceneModel) -> ReducedDuct:
    return load_duct(scene, cache_directory(), ignore_progress)


def _site(attached: bytes) -> Site:
    try:
        return read_site(attached)
    except ValueError as error:
        raise ConfigError(str(error)) from None
