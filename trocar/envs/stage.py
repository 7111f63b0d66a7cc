"""The scene of an episode at rest: rebuilt if it differs from the last one, otherwise reset."""

from __future__ import annotations

from pathlib import Path

from trocar.envs.ducts import OF_THIS_PROCESS, Ducts, SharedDuct
from trocar.envs.grips import Grips
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.snapshot import Snapshot
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_scene
from trocar.services.training.site import Site


class Stage:
    """A scene that is reset for each episode.

    Args:
        name, overrides: The scene, as for `trocar.load_scene`.
        quality: int, optional. Quality level of the scene; None for the last.
        ducts: Ducts, optional. Where its duct is kept, with those of other stages; None for those of the process.

    Attributes:
        simulation: Simulation. At rest after `begin_episode`.
        grips: Grips. Grasps of its tools.
    """

    def __init__(
        self,
        name: str | Path,
        overrides: tuple[str, ...] = (),
        quality: int | None = None,
        ducts: Ducts | None = None,
    ) -> None:
        self.name, self._overrides, self._quality = name, overrides, quality
        self._ducts = ducts or OF_THIS_PROCESS
        self._shared: SharedDuct | None = None
        self._drawn: tuple[str, ...] | None = None
        self.begin_episode()

    @property
    def overrides(self) -> tuple[str, ...]:
        """Present overrides of the scene."""
        return (*self._overrides, *(self._drawn or ()))

    def begin_episode(self, drawn: tuple[str, ...] = ()) -> Simulation:
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
        if self._shared is None or not self._shared.is_of(scene):
            self._shared = self._ducts.load(scene)
        self.scene, self._drawn, duct = scene, drawn, self._shared.duct
        self.simulation = Simulation(scene, duct)
        self._snapshot = Snapshot(self.simulation, (scene, self.simulation.scene, duct, self.simulation.duct.reduced))
        self.simulation.set_quality(self.level)
        self.grips = Grips(self.simulation.scene, duct)

    @property
    def _own(self) -> SharedDuct:
        assert self._shared is not None
        return self._shared

    @property
    def duct(self) -> ReducedDuct:
        """The duct, of this scene and perhaps of others."""
        return self._own.duct

    @property
    def site(self) -> Site:
        """Site of the duct, as read from a recording."""
        return self._own.site

    @property
    def ways(self) -> TubePaths:
        """Paths from the mouth of the duct to its ends."""
        return self._own.ways

    @property
    def duct_file(self) -> bytes:
        """The duct's attachment of a recording."""
        return self._own.attached
