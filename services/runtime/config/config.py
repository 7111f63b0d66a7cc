"""Configuration from YAML files and ``--set`` options: typed, without unknown keys, with every value's origin."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.config import yaml_text
from trocar.services.runtime.config.removed_keys import REMOVED_RIG_KEYS, drop_removed_keys
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import ConfigError

T = TypeVar("T")
Origins = dict[str, str]

_ROOT = Path(__file__).resolve().parents[3]
_INSTALLED = _ROOT / "trocar" / "configs"


def config_directory() -> Path:
    """Return the folder of rigs, scenes and devices: ``$TROCAR_CONFIG_DIR``, or that of the wheel or the clone.

    Raises ConfigError if the variable names no folder.
    """
    if named := os.environ.get("TROCAR_CONFIG_DIR"):
        if not os.path.isdir(named):
            raise ConfigError(f"TROCAR_CONFIG_DIR: {named}: there is no such folder")
        return Path(named)
    return _INSTALLED if _INSTALLED.is_dir() else _ROOT / "configs"


def find(kind: str, name: str | Path) -> Path:
    """Return the file of a rig, scene or device given its path or its bare name.

    Raises ConfigError naming the file and, for a bare name, the known ones.
    """
    path = Path(name)
    if path.suffix in (".yaml", ".yml"):
        if _is_there(path):
            return path
        raise ConfigError(f"{path}: there is no such {kind} file")
    folder = config_directory() / f"{kind}s"
    named = folder / f"{name}.yaml"
    if not _is_there(named):
        known = sorted(p.stem for p in folder.glob("*.yaml"))
        near = did_you_mean(name, known)
        raise ConfigError(f"there is no {kind} {str(name)!r} in {folder}; known: {', '.join(known) or 'none'}{near}")
    return named


def _is_there(path: Path) -> bool:
    """Return whether `path` is a file, or inaccessible so that only reading it gives the reason."""
    try:
        return path.is_file()
    except OSError:
        return True


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises ConfigError naming file and line, if it cannot be read, is not YAML, or is not a mapping.
    """
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(yaml_text.LONGEST_TEXT + 1)
        if len(text) > yaml_text.LONGEST_TEXT:
            raise ConfigError(f"{path}: has more than {yaml_text.LONGEST_TEXT:g} characters, that is no configuration")
        data = yaml_text.read(text)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" line {mark.line + 1}, column {mark.column + 1}:" if mark else ""
        raise ConfigError(f"{path}:{where} {getattr(error, 'problem', None) or 'is not YAML'}") from None
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: the file must be a mapping of keys to values")
    return data


def apply_overrides(data: dict[str, Any], overrides: Iterable[str], origins: Origins) -> None:
    """Apply each ``a.b=c`` of `overrides` to `data`; values are YAML, list items are addressed by number.

    Raises ConfigError naming an invalid option.
    """
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals or not key:
            raise ConfigError(f"--set {override}: expected key.path=value")
        if key == "base":
            raise ConfigError(f"--set {override}: a base is what a file is written on; name that rig file instead")
        try:
            value = yaml_text.read(text)
        except yaml.YAMLError as error:
            why = getattr(error, "problem", None) or "it cannot be read"
            raise ConfigError(f"--set {override}: {text!r} is not a YAML value: {why}") from None
        _put(data, key.split("."), value, override)
        for below in [each for each in origins if each.startswith(f"{key}.")]:  # what it took the place of
            del origins[below]
        origins[key] = "--set"


def _put(data: Any, path: list[str], value: Any, override: str) -> None:
    *parents, last = path
    try:
        for part in parents:
            data = data[_place(part)] if isinstance(data, list) else data.setdefault(part, {})
        data[_place(last) if isinstance(data, list) else last] = value
    except (ValueError, IndexError, TypeError, AttributeError):
        raise ConfigError(f"--set {override}: there is nothing to set at {'.'.join(path)}") from None


def _place(number: str) -> int:
    """Return the list index, from 0, in an option."""
    if not number.isdecimal():
        raise ValueError(number)
    return int(number)


def read_scene(scene: str | Path, overrides: Iterable[str] = (), origins: Origins | None = None) -> dict[str, Any]:
    """Return the unchecked content of a scene, by path or by name in configs/scenes, with overrides.

    The path of a surface file is made absolute, and products are replaced by their values, so that the content may be
    saved anywhere.
    Raises ConfigError if there is no such scene, or it is not YAML.
    """
    path = find("scene", scene)
    data = read_yaml(path)
    origins = {} if origins is None else origins
    origins.update(origins_of(data, str(path)))
    _anchor_mesh_file(data, path.parent)
    apply_overrides(data, overrides, origins)
    _anchor_mesh_file(data, Path.cwd())
    from trocar.services.runtime.config.products import take_products  # it is built of what is here

    take_products(data, str(path), origins)
    return data


def _anchor_mesh_file(data: dict[str, Any], folder: Path) -> None:
    """Make the path of a surface file absolute, relative to the scene's folder, or for an override the present one."""
    duct = data.get("duct")
    if isinstance(duct, dict) and isinstance(duct.get("mesh_file"), str):
        duct["mesh_file"] = str(folder.absolute() / duct["mesh_file"])


def build(kind: type[T], data: Mapping[str, Any], where: str) -> T:
    """Return `data` validated as `kind` (a pydantic model or a dataclass).

    It is validated as JSON, so that strict types accept no string for a number, but a list for a tuple.
    Raises ConfigError: one sentence with file, path of the key, the error, and for an unknown key the known ones.
    """
    try:
        return TypeAdapter(kind).validate_json(json.dumps(data, default=str))
    except ValidationError as error:
        empty = "" if data else "; nothing is in the file"
        raise ConfigError(f"{where}: {_sentence(error, kind)}{empty}") from None
    except (TypeError, ValueError) as error:  # such as a date as a key, or a recursive anchor
        raise ConfigError(f"{where}: {error}") from None


_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_MISSING = ("missing", "missing_argument")
_NO_KIND = "union_tag_not_found"
_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")


def _sentence(error: ValidationError, kind: type[Any]) -> str:
    """Return the error message; an unknown key comes first, as a misspelt key also causes a missing one."""
    errors = error.errors(include_url=False)
    first = next((each for each in errors if each["type"] in _UNKNOWN), errors[0])
    unknown = _unknown(first, kind)
    path = ".".join(str(part) for part in unknown or first["loc"] if part != "[key]")  # marks an invalid key
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    if unknown:
        known = known_keys(kind, unknown[:-1])
        near = did_you_mean(unknown[-1], known)
        return f"{path}: unknown key {str(unknown[-1])!r}; known: {', '.join(known) or 'none'}{more}{near}"
    if first["type"] in _MISSING:
        return f"{path}: this key is missing{more}"
    if first["type"] == _NO_KIND:
        key = str(first["ctx"]["discriminator"]).strip("'")
        return f"{'.'.join(filter(None, (path, key)))}: this key is missing{more}"
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] in _BOUNDS:
        message += f", is {first['input']!r}"
    choices = re.findall("'(.*?)'", str(first.get("ctx", {}).get("expected", "")))
    near = did_you_mean(first["input"], choices)
    return f"{path or 'file'}: {message[:1].lower()}{message[1:]}{more}{near}"


def _unknown(error: ErrorDetails, kind: Any) -> tuple[int | str, ...]:
    """Return the path of an unknown key, empty for none; it may be a misspelt key that selects a type."""
    if error["type"] in _UNKNOWN:
        return error["loc"]
    if error["type"] == _NO_KIND and isinstance(error["input"], Mapping):
        known = known_keys(kind, error["loc"])
        return next(((*error["loc"], key) for key in error["input"] if key not in known), ())
    return ()


def known_keys(kind: Any, location: tuple[int | str, ...]) -> list[str]:
    """Return the known keys of a configuration type at `location`, in pydantic's format."""
    schema = TypeAdapter(kind).json_schema()
    nodes = _alternatives(schema, schema)
    for part in location:
        below = [each for node in nodes for each in _below(node, part, schema)]
        nodes = below or [node for node in nodes if _is_called(node, part)]  # the selected type of a union
    return sorted({key for node in nodes for key in node.get("properties", {})})


def _alternatives(node: Any, schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the schemas of `node`: itself, its reference, or each member of a union."""
    if not isinstance(node, dict):
        return []
    if "$ref" in node:
        return _alternatives(schema["$defs"][node["$ref"].rpartition("/")[2]], schema)
    choices = [choice for word in ("anyOf", "oneOf", "allOf") for choice in node.get(word, ())]
    return [each for choice in choices for each in _alternatives(choice, schema)] or [node]


def _below(node: dict[str, Any], part: int | str, schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the schemas in `node` at a key or list index."""
    if isinstance(part, int):
        places = node.get("prefixItems", ())
        return _alternatives(places[part] if part < len(places) else node.get("items"), schema)
    return _alternatives(node.get("properties", {}).get(part, node.get("additionalProperties")), schema)


def _is_called(node: dict[str, Any], name: int | str) -> bool:
    """Return whether `name` is pydantic's name of a union's member: its type, or the value of the discriminator."""
    return name == node.get("title") or any(name == key.get("const") for key in node.get("properties", {}).values())


def origins_of(data: Mapping[str, Any], where: str, prefix: str = "") -> Origins:
    """Return the origin `where` for every leaf of `data`."""
    found: Origins = {}
    for key, value in data.items():
        path = f"{prefix}{key}"
        if isinstance(value, Mapping) and value:
            found |= origins_of(value, where, f"{path}.")
        else:
            found[path] = where
    return found


def naming_override(load: Callable[[Sequence[str]], T], overrides: Sequence[str], path: Path) -> T:
    """Return what `load` makes of a file and overrides; of a refusal, the override that brings it about is named.

    The file is at fault only where it is refused in the same words without the override.
    """
    try:
        return load(overrides)
    except ConfigError as error:
        said = str(error)
        guilty = next((n for n in range(len(overrides) + 1) if _refusal(load, overrides[:n]) == alone(said)), 0)
        if not guilty or said.startswith("--set "):
            raise
        in_file = re.compile(rf"{re.escape(str(path))}( on [^:]*)?: ")
        raise ConfigError(f"--set {overrides[guilty - 1]}: {in_file.sub('', said, count=1)}") from None


def _refusal(load: Callable[[Sequence[str]], object], overrides: Sequence[str]) -> str:
    try:
        load(overrides)
    except ConfigError as error:
        return alone(str(error))
    return ""


def alone(sentence: str) -> str:
    """Return what is wrong without the count of what else is."""
    return re.sub(r" \(and \d+ more\)", "", sentence)


def load(kind: type[T], path: Path, overrides: Iterable[str] = ()) -> tuple[T, Origins]:
    """Return the configuration in `path` with `overrides`, and the origin of each given value.

    A rig file may name another as its `base`, and then contains only the differences.
    Raises ConfigError: one sentence that names the file, or the override, and the key.
    """
    return naming_override(lambda some: _load(kind, path, some), tuple(overrides), path)


def _load(kind: type[T], path: Path, overrides: Sequence[str]) -> tuple[T, Origins]:
    data, origins = _read_on_base(path) if kind is Rig else _read_alone(path)
    apply_overrides(data, overrides, origins)
    where = f"{path} on {data['base']}" if kind is Rig and "base" in data else str(path)
    if kind is Rig:
        drop_removed_keys(data, where)
    if kind is Rig and isinstance(gateway := data.get("gateway"), dict) and gateway.get("instruments") == []:
        raise ConfigError(f"{where}: gateway.instruments: is empty: there is no hand to feel anything; name one")
    return build(kind, data, where), origins


def _read_alone(path: Path) -> tuple[dict[str, Any], Origins]:
    data = read_yaml(path)
    return data, origins_of(data, str(path))


def _read_on_base(path: Path, above: tuple[Path, ...] = ()) -> tuple[dict[str, Any], Origins]:
    """Return the content of a rig file merged into that of its base: mappings are merged, lists and values replaced.

    In a list of named items, such as instruments, the file defines which exist; each takes missing keys from the item
    of the same name in the base. `settings` belong to one driver and are replaced as a whole.
    """
    data, origins = _read_alone(path)
    base = data.get("base")
    if base is None:
        return data, origins
    if path.resolve() in above:
        raise ConfigError(f"{path}: base: the file is, by way of others, its own base")
    found, found_origins = _read_on_base(_find_base(path, base), (*above, path.resolve()))
    return _merged(found, data), {**found_origins, **origins}


def _find_base(path: Path, base: Any) -> Path:
    if not isinstance(base, str):
        raise ConfigError(f"{path}: base: must be the name of a rig, or a file beside this one")
    beside = path.parent / (base if base.endswith((".yaml", ".yml")) else f"{base}.yaml")
    try:
        return beside if _is_there(beside) else find("rig", base)
    except ConfigError as error:
        raise ConfigError(f"{path}: base: {error}") from None


def _merged(below: Any, above: Any) -> Any:
    if _are_named(below) and _are_named(above):
        known = {each["name"]: each for each in below}
        return [_merged(known.get(each["name"]), each) for each in above]
    if not isinstance(below, dict) or not isinstance(above, dict):
        return above
    merged = {key: value if key == "settings" else _merged(below.get(key), value) for key, value in above.items()}
    return {**below, **merged}


def _are_named(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(each, dict) and isinstance(each.get("name"), str) for each in value
    )


def split_overrides(overrides: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the overrides of the rig file (recognised by their first key), and all others, of the scene."""
    rig: list[str] = []
    scene: list[str] = []
    for override in overrides:
        first = override.split("=")[0].split(".")[0]
        (rig if first in Rig.model_fields or first in REMOVED_RIG_KEYS else scene).append(override)
    return tuple(rig), tuple(scene)


def load_rig(name: str | Path, overrides: Iterable[str] = ()) -> Rig:
    """Return the rig of a file or bare name, with those of `overrides` that are for the rig."""
    return load(Rig, find("rig", name), split_overrides(overrides)[0])[0]
