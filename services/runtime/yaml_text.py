"""YAML text as people write numbers: the safe subset, with the floats of YAML 1.2."""

from __future__ import annotations

import re
from typing import Any

import yaml


class _Loader(yaml.SafeLoader):
    """PyYAML reads YAML 1.1, where 3e-4 is a string: there a float needs a point, and its exponent a sign."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$"), list("-+.0123456789")
)


def read(text: str) -> Any:
    """Return what `text` says; raises yaml.YAMLError where it is not YAML."""
    return yaml.load(text, _Loader)
