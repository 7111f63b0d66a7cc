"""Names made of content: the same inputs give the same name, on any machine and in any run."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np


def hash_content(*values: object) -> str:
    """Return 32 hexadecimal digits for arrays, numbers, texts, and dataclasses, mappings and sequences of them.

    Raises TypeError if a value is of a kind whose content cannot be named.
    """
    digest = hashlib.blake2b(digest_size=16)
    for value in values:
        _feed(digest, value)
    return digest.hexdigest()


def hash_sources(*places: Path) -> str:
    """Return the hash of Python files and of all in and below folders, so that changed code does not meet old results.

    Raises FileNotFoundError if a file that is named is not there.
    """
    files = sorted(path for place in places for path in (place.rglob("*.py") if place.is_dir() else (place,)))
    return hash_content([path.read_bytes() for path in files])


def _feed(digest: hashlib.blake2b, value: Any) -> None:
    digest.update(type(value).__name__.encode() + b":")
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data.cast("B"))
    elif dataclasses.is_dataclass(value):
        _feed(digest, {field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
    elif isinstance(value, Mapping):
        _feed(digest, sorted(value.items()))
    elif isinstance(value, list | tuple):
        digest.update(str(len(value)).encode())
        for item in value:
            _feed(digest, item)
    elif isinstance(value, bytes):
        digest.update(str(len(value)).encode() + value)
    elif value is None or isinstance(value, bool | int | float | str):
        digest.update(repr(value).encode() + b";")
    else:
        raise TypeError(f"cannot name the content of a {type(value).__name__}")
