"""YAML text in the safe subset, with the numbers of YAML 1.2 and without duplicate keys."""

from __future__ import annotations

import re
from typing import Any

import yaml

LONGEST_TEXT = 1_000_000
"""Most characters of a file, as it may be an endless device: four hundred times the longest in configs."""
MOST_VALUES = LONGEST_TEXT
"""Limit of the values of a file with expanded aliases: no file without aliases has more values than characters."""
LARGEST_WHOLE = 2**63
"""Limit of whole numbers, as they must fit machine integers; larger quantities are written like 1e20."""

_STRANGE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")


class _Loader(yaml.SafeLoader):
    """PyYAML reads YAML 1.1, where 3e-4 is a string, 012 is ten and 1:30 ninety.

    It also silently takes the last of two equal keys, which YAML forbids.
    """

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Reject a duplicate key, except one merged with ``<<``."""
        node: yaml.MappingNode = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in lines:
                problem = f"key {key.value!r} is given twice, first in line {lines[key.value]}"
                raise yaml.composer.ComposerError(None, None, problem, key.start_mark)
            lines[key.value] = key.start_mark.line + 1
        return node

    def construct_scalar(self, node: Any) -> Any:
        """Reject characters that only escapes can write: surrogates, nulls, control codes."""
        value = super().construct_scalar(node)
        strange = _STRANGE.search(value)
        if strange:
            problem = f"a text holds the character U+{ord(strange[0]):04X}, which has no place in one"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return value

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Convert exceptions of PyYAML's conversions (the 45th of a month, a wrong tag) to errors with a position."""
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, AttributeError) as error:
            problem = f"{str(node.value)[:40]!r} is no value of {node.tag.rpartition(':')[2]}"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from error


_NUMBERS = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float"
_Loader.yaml_implicit_resolvers = {
    first: [each for each in resolvers if each[0] not in _NUMBERS]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_FLOAT = r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
_INT = r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$"
_Loader.add_implicit_resolver(_NUMBERS[0], re.compile(_INT), list("-+0123456789"))
_Loader.add_implicit_resolver(_NUMBERS[1], re.compile(_FLOAT), list("-+.0123456789"))


def _int(loader: _Loader, node: yaml.ScalarNode) -> int:
    """Return the value of an integer: decimal even with leading zeros, octal and hexadecimal by their prefix."""
    text = loader.construct_scalar(node)
    value = int(text, 0) if text[:2] in ("0o", "0x") else int(text)
    if abs(value) >= LARGEST_WHOLE:
        raise ValueError(text)
    return value


_Loader.add_constructor(_NUMBERS[0], _int)


def read(text: str) -> Any:
    """Return the data of `text`; raises yaml.YAMLError if it is not YAML."""
    try:
        value = yaml.load(text, _Loader)
        if _written_out(value, {}) > MOST_VALUES:
            raise yaml.MarkedYAMLError(problem=f"aliases stand for more than {MOST_VALUES:g} values")
        return value
    except RecursionError:
        raise yaml.MarkedYAMLError(problem="brackets are nested too deeply") from None


_BEGUN = -1  # smaller than any number of values


def _written_out(value: Any, known: dict[int, int]) -> int:
    """Return the number of values with expanded aliases."""
    if not isinstance(value, dict | list):
        return 1
    if known.get(id(value)) == _BEGUN:
        raise yaml.MarkedYAMLError(problem="an alias stands for what it is a part of")
    if id(value) not in known:
        known[id(value)] = _BEGUN
        items = value.values() if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_written_out(item, known) for item in items)
    return known[id(value)]
