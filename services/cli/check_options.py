"""Checks a rig's options as far as that needs no device and no eigenvalue; a message names the option at fault.

``python -m trocar.services.cli.check_options OPTIONS`` is the check alone, of rig, scene and overrides as a list in
JSON.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from trocar.services.files.cache_directory import cache_directory
from trocar.services.gateway.instruments.instrument import build_instruments
from trocar.services.mechanics.scene import SceneModel
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.bus import endpoints, keys
from trocar.services.runtime.config import config
from trocar.services.runtime.config.removed_keys import REMOVED_RIG_KEYS
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.config.scene_requirements import scene_requirements
from trocar.services.runtime.errors import ConfigError, UserError
from trocar.services.scenes import check_duct, scene_file_type, scene_origins

T = TypeVar("T")
Checked = tuple[T, config.Origins]
NamedLoad = tuple[str, Callable[[], object]]
#: The file that a sentence begins with.
_IN_FILE = re.compile(r"^\S+\.ya?ml( on \S+)?: ")


def checked_rig(name: str, scene: str | None, overrides: Sequence[str]) -> Checked[Rig]:
    """Return a rig whose scene could be built, and whose drivers take their settings; nothing is made for it.

    Raises UserError that names the option at fault.
    """

    def attempts() -> Iterator[NamedLoad]:
        yield f"--rig {name}", lambda: _load_rig(name, None, ())
        if scene is not None:
            yield f"--scene {scene}", lambda: _load_rig(name, scene, ())
        yield from _first_overrides(overrides, lambda some: _load_rig(name, scene, some))

    return _naming_option(lambda: _load_rig(name, scene, overrides), attempts())


def checked_scene(name: str, overrides: Sequence[str]) -> Checked[SceneModel]:
    """Return a scene whose duct could be built: with a mesh that is there, and so many modes as it has.

    Raises UserError that names the option at fault.
    """

    def attempts() -> Iterator[NamedLoad]:
        yield f"--scene {name}", lambda: _load_scene(name, ())
        yield from _first_overrides(overrides, lambda some: _load_scene(name, some))

    return _naming_option(lambda: _load_scene(name, overrides), attempts())


def _first_overrides(overrides: Sequence[str], load: Callable[[Sequence[str]], object]) -> Iterator[NamedLoad]:
    for count, override in enumerate(overrides, 1):
        yield f"--set {override}", lambda some=overrides[:count]: load(some)  # type: ignore[misc]


def _naming_option(load: Callable[[], T], attempts: Iterator[NamedLoad]) -> T:
    """Return what `load` does; of its refusal, the first of `attempts` with the same names its option."""
    try:
        return load()
    except UserError as error:
        option = next((option for option, attempt in attempts if _refusal(attempt) == config.alone(str(error))), "")
        if not str(error).startswith(option):
            named = option.partition(" ")[2]  # a file is not named twice, and none that an override spoils
            said = str(error).removeprefix(f"{named}: ")
            error.args = (f"{option}: {_IN_FILE.sub('', said) if option.startswith('--set ') else said}",)
        raise


def _refusal(attempt: Callable[[], object]) -> str:
    try:
        attempt()
    except UserError as error:
        return config.alone(str(error))
    return ""


def _load_rig(name: str, scene: str | None, overrides: Sequence[str]) -> Checked[Rig]:
    _refuse_unknown(overrides)
    of_rig, of_scene = config.split_overrides(overrides)
    rig, origins = config.load(Rig, config.find("rig", name), of_rig)
    endpoints.check(rig.transport)
    if rig.transport.keys is not None:
        keys.load(rig.transport.keys)
    scene = scene or rig.scene
    build_instruments(scene_requirements(scene, of_scene).fitted(rig).gateway)
    _load_scene(scene, of_scene)
    return rig, origins


def _refuse_unknown(overrides: Sequence[str]) -> None:
    """Refuse a key that is neither the rig's nor the scene's: which of both was meant is not known."""
    known = sorted({*Rig.model_fields, *scene_file_type().model_fields})
    for override in overrides:
        key = re.split(r"[.=]", override)[0]
        if key and key not in known and key not in REMOVED_RIG_KEYS:
            near = did_you_mean(key, known)
            raise ConfigError(f"{key}: unknown key {key!r} of rig and scene; known: {', '.join(known)}{near}")


def _load_scene(name: str, overrides: Sequence[str]) -> Checked[SceneModel]:
    scene, origins = scene_origins(name, overrides)
    check_duct(scene, cache_directory())
    return scene, origins


def main() -> int:
    """Check the options of the command line; return the exit code."""
    rig, scene, overrides = json.loads(sys.argv[1])
    try:
        checked_rig(rig, scene, overrides)
    except UserError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
