"""``trocar config show|schema``: what is in force, where each value came from, what may be written."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

import yaml
from pydantic import BaseModel, TypeAdapter

from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.config.scene_requirements import BESIDE_THE_DUCT
from trocar.services.runtime.errors import ConfigError

KINDS = ("rig", "scene", "device")


def run_show(origin: bool, as_json: bool, overrides: tuple[str, ...], **names: str | None) -> None:
    """Print the configuration that has a name, by kind, as YAML or JSON; with `origin`, where each value came from.

    Raises UserError for whatever `trocar up` would refuse, as far as no device and no eigenvalue is needed to know.
    """
    named = [kind for kind in KINDS if names[kind] is not None]
    if len(named) > 1:
        raise ConfigError(f"--{named[0]} and --{named[1]}: show one at a time")
    kind = named[0] if named else "rig"
    value, origins = load_checked(kind, names[kind] or "stub", overrides)
    data = plain(value)
    for key in BESIDE_THE_DUCT if kind == "scene" and value.duct_alone else ():
        del data[key]  # whoever names it has more than a duct
    if origin:
        lines = {path: (leaf, _origin(path, origins)) for path, leaf in leaves(data).items()}
        if as_json:
            print(json.dumps({path: {"value": v, "origin": o} for path, (v, o) in lines.items()}, indent=1))
            return
        width = max((len(path) for path in lines), default=0)
        for path, (leaf, where) in lines.items():
            print(f"{path:{width}}  {json.dumps(leaf)}  [{where}]")
    elif as_json:
        print(json.dumps(data, indent=1))
    else:
        print(yaml.safe_dump(data, sort_keys=False, allow_unicode=True), end="")


def run_schema(kind: str) -> None:
    """Print the JSON schema of a kind of file."""
    if kind not in KINDS:
        near = did_you_mean(kind, KINDS)
        raise ConfigError(f"there is no configuration {kind!r}; known: {', '.join(KINDS)}{near}")
    print(json.dumps(TypeAdapter(type_of(kind)).json_schema(), indent=1))


def type_of(kind: str) -> Any:
    """Return the type that a kind of file is checked against."""
    if kind == "rig":
        return Rig
    if kind == "scene":
        from trocar.services.scenes import scene_file_type

        return scene_file_type()
    from trocar.services.gateway.devices.device_files import DeviceFile

    return DeviceFile


def load_checked(kind: str, name: str, overrides: tuple[str, ...] = ()) -> tuple[Any, config.Origins]:
    """Return the rig, scene or device of a name or file, and where each value came from.

    Raises UserError for whatever `trocar up` would refuse.
    """
    from trocar.services.cli.check_options import checked_rig, checked_scene

    if kind == "scene":
        return checked_scene(name, overrides)
    if kind == "rig":
        return checked_rig(name, None, overrides)
    return config.load(type_of(kind), config.find(kind, name), overrides)


def plain(value: Any) -> Any:
    """Return a model or dataclass as what YAML and JSON can hold."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value) if "follows" not in f.metadata}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def leaves(data: Any, prefix: str = "") -> dict[str, Any]:
    """Return every value of nested mappings by its dotted path; lists count as values unless they hold mappings."""
    if isinstance(data, dict) and data:
        pairs = [(str(key), item) for key, item in data.items()]
    elif isinstance(data, list) and any(isinstance(item, dict) for item in data):
        pairs = [(str(index), item) for index, item in enumerate(data)]
    else:
        return {prefix: data}
    found: dict[str, Any] = {}
    for key, item in pairs:
        found |= leaves(item, f"{prefix}.{key}" if prefix else key)
    return found


def _origin(path: str, origins: config.Origins) -> str:
    """Return where the value at `path` came from: the nearest key above it that was given, else the default."""
    parts = path.split(".")
    for length in range(len(parts), 0, -1):
        origin = origins.get(".".join(parts[:length]))
        if origin is not None:
            return origin
    return "default"
