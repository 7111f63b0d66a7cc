"""Rows that say what a file's keys mean: ``python -m trocar.review.settings.rows KIND FILE`` checks it and writes them.

It is a process of its own: what a scene is checked against takes a second and 100 MB to import.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from trocar.services.cli.show_config import leaves, load_checked, plain, type_of
from trocar.services.runtime.config.config import Origins
from trocar.services.runtime.errors import UserError

_KINDS = ("boolean", "integer", "number", "string")


def rows_of(kind: str, file: str) -> list[dict[str, Any]]:
    """Return of each key of a file its value, where that comes from, and what its schema says.

    Raises UserError: one sentence that names the file and the key.
    """
    value, origins = load_checked(kind, file)
    schema = TypeAdapter(type_of(kind)).json_schema()
    data = plain(value)
    return [
        {"key": key, "value": leaf, "from": _source(key, origins, file), **_meaning(schema, data, key)}
        for key, leaf in leaves(data).items()
    ]


def _source(key: str, origins: Origins, file: str) -> str:
    """Return where a value comes from: `file`, the name of the file that this is based on, or empty for a default."""
    parts = key.split(".")
    names = (".".join(parts[:length]) for length in range(len(parts), 0, -1))
    origin = next((origins[name] for name in names if name in origins), "")
    return "file" if file in origin else Path(origin).name


def _meaning(schema: dict[str, Any], data: Any, key: str) -> dict[str, Any]:
    """Return description, kind, choices and bounds of a key."""
    nodes = [schema]
    for part in key.split("."):
        nodes = [each for node in nodes for each in _below(node, part, data, schema)]
        data = data[int(part)] if isinstance(data, list) else data.get(part) if isinstance(data, dict) else None
    all_of = [each for node in nodes for each in _members(node, schema)]
    kinds = {str(each.get("type")) for each in all_of} - {"null"}
    choices = [choice for each in all_of for choice in (each.get("enum") or _constant(each))]
    bounds = {name: each[word] for each in all_of for word, name in _BOUNDS.items() if word in each}
    about = next((str(node["description"]) for node in nodes if "description" in node), "")
    kind = kinds.pop() if len(kinds) == 1 and kinds <= set(_KINDS) else "yaml"
    return {"about": about, "kind": "choice" if choices and kind in ("string", "yaml") else kind, "choices": choices,
            "optional": any(each.get("type") == "null" for each in all_of), **bounds}  # fmt: skip


_BOUNDS = {"minimum": "least", "exclusiveMinimum": "above", "maximum": "most", "exclusiveMaximum": "below"}


def _constant(node: dict[str, Any]) -> list[Any]:
    return [node["const"]] if "const" in node else []


def _members(node: Any, schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the schemas that a schema stands for: of its reference, and of each member of a union."""
    if not isinstance(node, dict):
        return
    if "$ref" in node:
        yield from _members(schema["$defs"][node["$ref"].rpartition("/")[2]], schema)
        return
    members = [each for word in ("anyOf", "oneOf", "allOf") for each in node.get(word, ())]
    if not members:
        yield node
    for each in members:
        yield from _members(each, schema)


def _below(node: dict[str, Any], part: str, data: Any, schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the schemas at a key or number below a schema; of a union, those of the members that fit `data`."""
    found = []
    for each in _members(node, schema):
        if not _fits(each, data):
            continue
        if isinstance(data, list):
            places = each.get("prefixItems", ())
            below = places[int(part)] if int(part) < len(places) else each.get("items")
        else:
            below = each.get("properties", {}).get(part, each.get("additionalProperties"))
        if isinstance(below, dict):
            found.append(below)
    return found


def _fits(node: dict[str, Any], data: Any) -> bool:
    """Return whether `data` may be of a member of a union: its constants are those of `data`."""
    fixed = {key: each["const"] for key, each in node.get("properties", {}).items() if "const" in each}
    return all(not isinstance(data, dict) or data.get(key) == value for key, value in fixed.items())


def main(kind: str, file: str) -> int:
    """Print the rows, or the sentence that refuses the file; return the exit code."""
    try:
        sys.stdout.write(json.dumps(rows_of(kind, file), default=str))
    except UserError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
