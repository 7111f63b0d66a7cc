"""What a scene file may say: the scene's own dataclasses, checked strictly, each effect's settings among them."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from operator import or_
from typing import Any, get_type_hints

import pydantic
from typing_extensions import TypedDict

from trocar.services.mechanics.effects import EFFECTS, check_bodies, check_ladder
from trocar.services.mechanics.scene import SceneModel, ToolScene
from trocar.services.mechanics.scene.instruments import TOOLS, USUAL
from trocar.services.mechanics.simulation.scene_catheter import check_catheter
from trocar.services.mechanics.simulation.scene_duct import check_duct_numbers
from trocar.services.mechanics.simulation.scene_world import check_integrator
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.config import config
from trocar.services.runtime.config.scene_requirements import has_duct_alone
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import limits

# The dataclasses inside have no configuration of their own and take this one.
_STRICT = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


def scene_file_type(tools: tuple[type[ToolScene], ...] | None = None) -> type[pydantic.BaseModel]:
    """Return the type that scene files are checked against, as the tables of effects and tools are now.

    With ``tools``, the kinds that a file names: then only what these know is known.
    """
    forceps: Any = tuple[functools.reduce(or_, TOOLS.values()), ...] if tools is None else tuple[tools]  # type: ignore[misc, valid-type]
    return _file_type(forceps, tuple((name, entry.kind.Settings) for name, entry in EFFECTS.items()))


@functools.cache
def _file_type(forceps: Any, effects: tuple[tuple[str, Any], ...]) -> type[pydantic.BaseModel]:
    kinds = get_type_hints(SceneModel) | {"forceps": forceps}
    kinds["effects"] = TypedDict("Effects", dict(effects), total=False)  # type: ignore[operator]
    said = [field for field in fields(SceneModel) if "follows" not in field.metadata]
    keys: dict[str, Any] = {field.name: (kinds[field.name], _default(field)) for field in said}
    made: type[pydantic.BaseModel] = pydantic.create_model("Scene", __config__=_STRICT, **keys)
    return made


def _default(field: Field[Any]) -> Any:
    if field.default_factory is not MISSING:
        return pydantic.Field(default_factory=field.default_factory)
    return field.default


def _named_tools(data: Mapping[str, Any], where: str) -> tuple[type[ToolScene], ...] | None:
    """Return the kinds of a scene's tools, None where it names none."""
    named = data.get("forceps")
    if not isinstance(named, list) or not named:
        return None
    kinds = [each.get("kind", USUAL) if isinstance(each, Mapping) else USUAL for each in named]
    for k, kind in enumerate(kinds):
        if not isinstance(kind, str) or kind not in TOOLS:
            near = did_you_mean(kind, TOOLS)
            raise ConfigError(f"{where}: forceps.{k}.kind: there is no tool {kind!r}; known: {', '.join(TOOLS)}{near}")
    return tuple(TOOLS[kind] for kind in kinds)


def build_scene(data: Mapping[str, Any], where: str) -> SceneModel:
    """Return the scene that the mapping of a file describes.

    Raises ConfigError: one sentence that begins with `where` and the path of the key.
    """
    checked = config.build(scene_file_type(_named_tools(data, where)), data, where)
    said = {name: getattr(checked, name) for name in type(checked).model_fields}
    if has_duct_alone(data):
        if data.get("hands", "none") != "none":
            raise ConfigError(f"{where}: hands: {data['hands']} needs a tool, and the scene names but a duct")
        said.update(duct_alone=True, hands="none")
    scene = SceneModel(**said, source=where)
    if wrong := limits.fault(scene):
        raise ConfigError(f"{where}: {wrong}")
    try:
        check_duct_numbers(scene.duct)
        check_integrator(scene)
        check_ladder(scene)
        check_bodies(scene)
        check_catheter(scene)
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from None
    return scene
