"""Scene files to `SceneModel`: what a person wrote is checked here, key by key, before any mechanics sees it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from services.mechanics.scene import SceneModel
from services.runtime import config
from services.scenes.automatic_cells import take_automatic_cells
from services.scenes.preset import take_tissue
from services.scenes.scene_file import build_scene


def load_scene(name: str | Path, overrides: Iterable[str] = ()) -> SceneModel:
    """Return the scene of a file, or of a bare name in configs/scenes, with ``key.path=value`` overrides on top.

    Raises
    ------
    ConfigError
        one sentence that names the file and the key.
    """
    return scene_origins(name, overrides)[0]


def scene_origins(name: str | Path, overrides: Iterable[str] = ()) -> tuple[SceneModel, config.Origins]:
    """Return the scene, and for each value that was given where it came from."""
    path = config.find("scene", name)
    origins: config.Origins = {}
    data = scene_data(name, overrides, origins)
    take_tissue(data, str(path), origins)
    take_automatic_cells(data, origins)
    return build_scene(data, str(path)), origins


def scene_data(
    name: str | Path, overrides: Iterable[str] = (), origins: config.Origins | None = None
) -> dict[str, Any]:
    """Return what a scene file says with overrides on top: another file of that is the same scene, wherever it lies.

    Raises
    ------
    ConfigError
        if there is no such file, or it is no YAML.
    """
    path = config.find("scene", name)
    data = config.read_yaml(path)
    origins = {} if origins is None else origins
    origins.update(config.origins_of(data, str(path)))
    _anchor_mesh_file(data, path.parent)
    config.apply_overrides(data, overrides, origins)
    return data


def _anchor_mesh_file(data: dict[str, Any], folder: Path) -> None:
    """Make a relative surface file count from the scene's folder; one given by an override counts from here."""
    duct = data.get("duct")
    if isinstance(duct, dict) and isinstance(duct.get("mesh_file"), str):
        duct["mesh_file"] = str(folder / duct["mesh_file"])
