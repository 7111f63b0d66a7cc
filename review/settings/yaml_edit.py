"""One value of a YAML text changed, with everything else, comments too, as it was."""

from __future__ import annotations

import copy
import json
from typing import Any

import yaml

from trocar.services.runtime.config import yaml_text
from trocar.services.runtime.errors import ConfigError


def with_value(text: str, key: str, value: str) -> str:
    """Return a text in which the value at a dotted key, items of lists by number, is what the YAML `value` says.

    Raises ConfigError if the text or the value is no YAML, or the key has no place in the text.
    """
    try:
        data = yaml_text.read(text)
        root = yaml.compose(text, yaml.SafeLoader)
        wanted = yaml_text.read(value)
    except yaml.YAMLError as error:
        raise ConfigError(f"{key}: {getattr(error, 'problem', None) or 'is not YAML'}") from None
    expected = _with(copy.deepcopy(data), key.split("."), wanted)
    for written in (value.strip(), json.dumps(wanted, ensure_ascii=False, default=str)):
        changed = _edited(text, root, key.split("."), written)
        if changed is not None and _says(changed, expected):
            return changed
    raise ConfigError(f"{key}: cannot be set alone here: write it into the text")


def _with(data: Any, path: list[str], value: Any) -> Any:
    """Return data in which what is at a path is another; what is missing or empty above it becomes a mapping."""
    if not path:
        return value
    first, *rest = path
    if isinstance(data, list) and first.isdecimal() and int(first) < len(data):
        data[int(first)] = _with(data[int(first)], rest, value)
    elif isinstance(data, dict) or data is None:
        data = {**(data or {}), first: _with((data or {}).get(first), rest, value)}
    return data


def _says(text: str, expected: Any) -> bool:
    try:
        return bool(yaml_text.read(text) == expected)
    except yaml.YAMLError:
        return False


def _edited(text: str, root: Any, path: list[str], value: str) -> str | None:
    if root is None:
        return f"{text.rstrip()}\n{_nested(path, value)}\n".lstrip("\n")
    node, parent_key, rest = root, None, path
    while rest:
        below = _below(node, rest[0])
        if below is None:
            break
        parent_key, node = below
        rest = rest[1:]
    if not rest:
        return _replaced(text, parent_key, node, value)
    if isinstance(node, yaml.MappingNode):
        return _added(text, node, _nested(rest, value))
    if isinstance(node, yaml.ScalarNode) and node.tag.endswith(":null") and parent_key is not None:
        return _replaced(text, parent_key, node, f"{{{_nested(rest, value)}}}")
    return None


def _below(node: Any, part: str) -> tuple[Any, Any] | None:
    """Return key and value of a mapping, or an item of a list; None if it is not there."""
    if isinstance(node, yaml.MappingNode):
        return next(((key, value) for key, value in node.value if getattr(key, "value", None) == part), None)
    if isinstance(node, yaml.SequenceNode) and part.isdecimal() and int(part) < len(node.value):
        return None, node.value[int(part)]
    return None


def _replaced(text: str, key: Any, node: Any, value: str) -> str:
    begin, end = node.start_mark.index, _end(node)
    if begin >= end and key is not None:  # nothing stands after the colon
        begin = end = text.index(":", key.end_mark.index) + 1
        return f"{text[:begin]} {value}{text[end:]}"
    return text[:begin] + value + text[end:]


def _added(text: str, node: Any, entry: str) -> str:
    if not node.value:
        end = node.end_mark.index - 1
        return f"{text[:end]}{entry}{text[end:]}"
    end = max(_end(value) if _end(value) > value.start_mark.index else key.end_mark.index for key, value in node.value)
    if node.flow_style:
        return f"{text[:end]}, {entry}{text[end:]}"
    line = text.find("\n", end)
    line = len(text) if line < 0 else line
    indent = " " * node.value[0][0].start_mark.column
    return f"{text[:line]}\n{indent}{entry}{text[line:]}"


def _end(node: Any) -> int:
    """Return where a node's own characters end: PyYAML has a block end with the blank lines and comments after it."""
    if isinstance(node, yaml.ScalarNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return max(_end(each) for each in last) if isinstance(last, tuple) else _end(last)


def _nested(path: list[str], value: str) -> str:
    first, *rest = path
    return f"{first}: {{{_nested(rest, value)}}}" if rest else f"{first}: {value}"
