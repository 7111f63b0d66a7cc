"""Scene files to `SceneModel`: what a person wrote is checked here, key by key, before any mechanics sees it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from services.mechanics.effects import build_effects
from services.mechanics.scene import SceneModel
from services.runtime import config
from services.runtime.errors import ConfigError


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
    data = config.read_yaml(path)
    origins = config.origins_of(data, str(path))
    _anchor_mesh_file(data, path.parent)
    config.apply_overrides(data, overrides, origins)
    _refuse_unknown(data, SceneModel, str(path), ())
    scene = config.build(SceneModel, data, str(path))
    try:
        build_effects(scene)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None
    return scene, origins


def _anchor_mesh_file(data: dict[str, Any], folder: Path) -> None:
    """Make a relative surface file count from the scene's folder; one given by an override counts from here."""
    duct = data.get("duct")
    if isinstance(duct, dict) and isinstance(duct.get("mesh_file"), str):
        duct["mesh_file"] = str(folder / duct["mesh_file"])


def _refuse_unknown(data: Mapping[str, Any], kind: Any, where: str, location: tuple[int | str, ...]) -> None:
    """Refuse keys that the scene's dataclasses do not have: pydantic skips them in plain dataclasses."""
    known = config.known_keys(kind, location)
    for key, value in data.items():
        path = (*location, key)
        if known and key not in known:
            dotted = ".".join(map(str, path))
            raise ConfigError(f"{where}: {dotted}: unknown key {key!r}; known: {', '.join(known)}")
        if path == ("effects",):  # each effect has settings of its own, which the table of effects checks
            continue
        if isinstance(value, Mapping):
            _refuse_unknown(value, kind, where, path)
        elif isinstance(value, list):
            for index, item in enumerate(value):
                if isinstance(item, Mapping):
                    _refuse_unknown(item, kind, where, (*path, index))
