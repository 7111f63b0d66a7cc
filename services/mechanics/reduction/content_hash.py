"""Names made of content: the same inputs give the same name, on any machine and in any run."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from trocar.services.kernels.source_closure import own_sources


def hash_content(*values: object) -> str:
    """Return 32 hexadecimal digits for arrays, numbers, texts, and dataclasses, mappings and sequences of them.

    Raises TypeError if a value is of a kind whose content cannot be named.
    """
    digest = hashlib.blake2b(digest_size=16)
    for value in values:
        _feed(digest, value)
    return digest.hexdigest()


def entry_name(kind: str, modules: str | tuple[str, ...], *content: object) -> str:
    """Return the name of an entry of the cache: its kind, and a hash of its content and of the code that makes it.

    ``modules`` are those that make it. With all of ours that they import, directly or not, they are the code, so that
    changed code never meets old results.
    """
    own = (modules,) if isinstance(modules, str) else modules
    return f"{kind}-{hash_content(*content, [own_sources().digest(module) for module in own])}"


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
