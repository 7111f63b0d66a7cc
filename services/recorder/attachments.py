"""Attachments that make a recording self-contained: scene, rig and devices as run, and the duct's surface."""

from __future__ import annotations

import json
from collections.abc import Iterator

import yaml

from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig
from trocar.services.scenes.duct_file import duct_file

YAML, NPZ = "application/yaml", "application/x-npz"
Attached = tuple[str, str, bytes]


def settings(rig: Rig, scene: str, overrides: tuple[str, ...]) -> Iterator[Attached]:
    """Yield name, media type and content of the rig's settings."""
    yield "scene.yaml", YAML, _yaml(config.read_scene(scene, overrides))
    yield "rig.yaml", YAML, _yaml(json.loads(rig.model_dump_json()))
    drivers = [driver for each in rig.gateway.instruments for driver in (each.arm, each.grasp) if driver is not None]
    for device in dict.fromkeys(driver.device for driver in drivers if driver.device is not None):
        path = config.find("device", device)
        yield f"devices/{path.name}", YAML, path.read_bytes()


def surface(duct: ReducedDuct, scene: SceneModel | None = None) -> Attached:
    """Return the duct's mesh and modes, from which nodes follow by the recorded coordinates, and its clip's place."""
    return "duct.npz", NPZ, duct_file(duct, scene)


def _yaml(data: object) -> bytes:
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True).encode()
