"""Scene files to `SceneModel`: what a person wrote is checked here, key by key, before any mechanics sees it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.config import config
from trocar.services.scenes.automatic_cells import take_automatic_cells
from trocar.services.scenes.preset import take_tissue
from trocar.services.scenes.scene_file import build_scene


def load_scene(name: str | Path, overrides: Iterable[str] = ()) -> SceneModel:
    """Return the scene of a file, or of a bare name in configs/scenes, with ``key.path=value`` overrides on top.

    Raises ConfigError: one sentence that names the file and the key.
    """
    return scene_origins(name, overrides)[0]


def scene_origins(name: str | Path, overrides: Iterable[str] = ()) -> tuple[SceneModel, config.Origins]:
    """Return the scene, and for each value that was given where it came from."""
    path = config.find("scene", name)
    return config.naming_override(lambda some: _scene_origins(name, path, some), tuple(overrides), path)


def _scene_origins(name: str | Path, path: Path, overrides: Sequence[str]) -> tuple[SceneModel, config.Origins]:
    origins: config.Origins = {}
    data = config.read_scene(name, overrides, origins)
    take_tissue(data, str(path), origins)
    take_automatic_cells(data, origins)
    return build_scene(data, str(path)), origins
