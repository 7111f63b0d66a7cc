"""Ducts of the scenes of a process: what no step changes is there once, however many scenes have it."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Self
from weakref import WeakSet

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.reduction.build import ignore_progress
from trocar.services.mechanics.reduction.residual.cached_rows import CachedRows
from trocar.services.mechanics.scene import SceneModel
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_duct
from trocar.services.scenes.duct_file import duct_file
from trocar.services.training.site import Site, read_site

_BATCH_ROWS = 1024
"""Rows of the residual that a batch caches, if the mesh allows: scenes load other nodes."""


class SharedDuct:
    """A duct at rest, with what is derived from it once.

    Attributes:
        duct: ReducedDuct
        attached: bytes. Its attachment of a recording.
        site: Site. Its site, as read from a recording.
        ways: TubePaths. Paths from its mouth to its ends.
    """

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        self._scene = scene
        self.duct, self.attached = duct, duct_file(duct)
        try:
            self.site: Site = read_site(self.attached)
        except ValueError as error:
            raise ConfigError(str(error)) from None
        self.ways = TubePaths({name: np.array(way) for name, way in self.site.ways.items()})

    def is_of(self, scene: SceneModel) -> bool:
        """Return whether it is the duct of this scene, too."""
        return (self._scene.duct, self._scene.effects) == (scene.duct, scene.effects)


class Ducts:
    """The ducts that scenes use at present, each loaded once; a duct that no scene uses any more is forgotten.

    Args:
        one_thread: bool. Whether one thread alone steps all scenes of these ducts, so that they may also share what a
            step writes to: the cache of the residual.
    """

    def __init__(self, *, one_thread: bool = False) -> None:
        self._one_thread = one_thread
        self._known: WeakSet[SharedDuct] = WeakSet()
        self._loading = threading.Lock()

    def load(self, scene: SceneModel) -> SharedDuct:
        """Return the duct of a scene. Raises ConfigError: one sentence, if the scene's duct cannot be used."""
        with self._loading:
            for each in self._known:
                if each.is_of(scene):
                    return each
            duct = load_duct(scene, cache_directory(), ignore_progress)
            if self._one_thread:
                duct = replace(duct, rows=CachedRows.of(duct.residual, _BATCH_ROWS))
            shared = SharedDuct(scene, duct)
            self._known.add(shared)
            return shared

    def __len__(self) -> int:
        """Return the number of ducts in use."""
        return len(self._known)

    def __bool__(self) -> bool:
        """Return True, also if no duct is in use."""
        return True

    def __deepcopy__(self, _memo: Mapping[int, Any]) -> Self:
        """Return itself: Gymnasium copies the arguments of an environment, whose scenes still share their ducts."""
        return self


OF_THIS_PROCESS = Ducts()
"""Ducts of all environments that are given no others."""
