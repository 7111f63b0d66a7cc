"""The configuration of a running rig, frozen at its start.

Processes that are started, even hours later, get copies of the files: rig and scene merged with all overrides, and
devices, scenarios, scripts and scores. A file that has changed meanwhile is reported once, and has no effect.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig, Transport
from trocar.services.runtime.private_directory import make_private
from trocar.services.runtime.process.process import Process

#: The files, of a few kB, are read whole each time; who has saved one is told before he looks for its effect.
_LOOK_S = 1.0


def freeze(process: Process) -> tuple[tuple[str, ...], dict[str, str]]:
    """Copy the configuration into the rig's private directory; return arguments and environment that refer to it.

    What is given by name keeps its name; what is given as a file gets another path.
    Raises ConfigError if there is no such file.
    """
    rig = process.rig
    folder = make_private(_folder(rig.transport))
    shutil.rmtree(folder)
    shutil.copytree(config.config_directory(), folder)
    data = rig.model_dump(mode="json", exclude_defaults=True, exclude={"base"})
    for kind, owner, key in _named_by(data):
        if _is_file(owner[key]):
            owner[key] = str(shutil.copy(config.find(kind, owner[key]), _place(folder, owner[key])))
    scene = process.scene_name
    is_file = _is_file(scene)
    frozen_scene = _place(folder, scene) if is_file else folder / "scenes" / f"{scene}.yaml"
    _write(frozen_scene, config.read_scene(scene, process.scene_overrides))
    scenario = data.get("training", {}).get("scenario")
    if is_file and scenario is not None:
        copy = Path(scenario) if _is_file(scenario) else folder / "scenarios" / f"{scenario}.yaml"
        content = config.read_yaml(copy)
        if content.get("scene") == scene:  # one of another scene is refused by training
            _write(copy, content | {"scene": str(frozen_scene)})
    frozen_rig = _place(folder, "rig.yaml")
    _write(frozen_rig, data)
    arguments = ("--rig", str(frozen_rig), "--scene", str(frozen_scene) if is_file else scene)
    return arguments, {"TROCAR_CONFIG_DIR": str(folder), "TROCAR_SET": ""}


def remove(transport: Transport) -> None:
    """Remove the copies of a rig that has ended."""
    shutil.rmtree(_folder(transport), ignore_errors=True)


def files_of(rig: Rig, rig_name: str, scene: str) -> set[Path]:
    """Return the files that were read, of the rig and its bases, the scene, and what the rig names."""
    rig_files = {Path(origin) for origin in config.load(Rig, config.find("rig", rig_name))[1].values()}
    named = {_path(kind, owner[key]) for kind, owner, key in _named_by(rig.model_dump(mode="json"))}
    there = {path for path in named if os.path.isfile(path)}  # the others are read on other hosts, or by nobody
    return rig_files | there | {config.find("scene", scene)}


class ChangedFiles:
    """Reports once for each file that its content has changed."""

    def __init__(self, files: Iterable[Path], say: Callable[[str, str], None]) -> None:
        self._read = {path: _content(path) for path in files}
        self._say = say
        self._look_s = 0.0

    def run_turn(self, now_s: float) -> None:
        """Check the files, if due."""
        if now_s < self._look_s:
            return
        self._look_s = now_s + _LOOK_S
        for path in [path for path, content in self._read.items() if _content(path) != content]:
            del self._read[path]
            text = "has changed since the rig began, which goes on as it was read; the next start takes the change"
            self._say("warning", f"supervisor: {path} {text}")


def _named_by(rig: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield each place where the data of a rig name another file: its kind, the mapping that names it, and the key."""
    for instrument in rig.get("gateway", {}).get("instruments", ()):
        for driver in filter(None, (instrument["arm"], instrument.get("grasp"))):
            if driver.get("device") is not None:
                yield "device", driver, "device"
            if isinstance(driver.get("settings", {}).get("script"), str):
                yield "script", driver["settings"], "script"
    if rig.get("training", {}).get("scenario") is not None:
        yield "scenario", rig["training"], "scenario"


def _folder(transport: Transport) -> Path:
    return endpoints.run_directory(transport) / "configuration"


def _place(folder: Path, name: str) -> Path:
    """Return the path of the copy of a file: in a folder of its own, as files of one name may come from several."""
    given = folder / "given"
    given.mkdir(exist_ok=True)
    place = given / str(len(list(given.iterdir())))
    place.mkdir()
    return place / Path(name).name


def _path(kind: str, name: str) -> Path:
    return Path(name) if _is_file(name) else config.config_directory() / f"{kind}s" / f"{name}.yaml"


def _is_file(name: str | None) -> bool:
    """Return whether a configuration is given as a file and not by name."""
    return name is not None and Path(name).suffix in (".yaml", ".yml")


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def _write(path: Path, data: Mapping[str, object]) -> None:
    path.write_text(yaml.safe_dump(dict(data), sort_keys=False, allow_unicode=True), encoding="utf-8")
