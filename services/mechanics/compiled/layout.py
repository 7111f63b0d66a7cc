"""Memory layout of a struct: words of eight bytes, derived from the annotations of its class.

Word 0 is a tag that names the layout, each field has one word, each named extent of its arrays another.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class ArrayField:
    """An array; its word holds the address of the first item.

    Attributes:
        dtype: str. numpy's name of it.
        extents: tuple of int or str. A number is a fixed extent, a name one that fields of a struct share.
    """

    word: int
    dtype: str
    extents: tuple[int | str, ...]

    def __str__(self) -> str:
        return f"{self.dtype} array ({', '.join(map(str, self.extents))}{',' * (len(self.extents) == 1)})"


@dataclass(frozen=True)
class ScalarField:
    """A float, an int or a bool, stored in its word."""

    word: int
    kind: str


@dataclass(frozen=True)
class StructField:
    """Another struct; its word holds the address."""

    word: int
    layout: Layout


Field = ArrayField | ScalarField | StructField


@dataclass(frozen=True)
class Layout:
    """Fields by name, and the words of the named extents."""

    name: str
    fields: tuple[tuple[str, Field], ...]
    extents: tuple[tuple[str, int], ...]

    @property
    def n_words(self) -> int:
        """Number of words."""
        return 1 + len(self.fields) + len(self.extents)

    @functools.cached_property
    def digest(self) -> str:
        """Hash that identifies this layout among all others, even of the same name."""
        return hashlib.sha256(repr(self).encode()).hexdigest()[:12]

    @property
    def tag(self) -> int:
        """First word of every struct of this layout."""
        return int(self.digest, 16)


def layout_of(cls: type, struct_base: type) -> Layout:
    """Read the annotations of ``cls``. Raises TypeError if a field is no annotated array, number or struct."""
    hints = {
        name: hint
        for name, hint in get_type_hints(cls, include_extras=True).items()
        if name not in struct_base.__annotations__
    }
    fields: list[tuple[str, Field]] = []
    for word, (name, hint) in enumerate(hints.items(), start=1):
        field = _field(hint, word, struct_base)
        if field is None:
            raise TypeError(
                f"{cls.__name__}.{name}: a field is float, int, bool, a struct, or an array with its extents as in"
                f' Annotated[FloatArray, "n", 3]; not {hint}'
            )
        fields.append((name, field))
    names = dict.fromkeys(_named_extents(field for _, field in fields))
    extents = tuple((name, word) for word, name in enumerate(names, start=1 + len(fields)))
    return Layout(cls.__qualname__, tuple(fields), extents)


def _field(hint: Any, word: int, struct_base: type) -> Field | None:
    if hint in (float, int, bool):
        return ScalarField(word, hint.__name__)
    if isinstance(hint, type) and issubclass(hint, struct_base):
        layout: Layout = hint.layout  # type: ignore[attr-defined]  # every subclass of Struct has one
        return StructField(word, layout)
    if get_origin(hint) is not Annotated:
        return None
    array, *extents = get_args(hint)
    if get_origin(array) is not np.ndarray or not extents or not all(isinstance(e, int | str) for e in extents):
        return None
    (scalar,) = get_args(get_args(array)[1])
    return ArrayField(word, np.dtype(scalar).name, tuple(extents))


def _named_extents(fields: Iterator[Field]) -> Iterator[str]:
    for field in fields:
        if isinstance(field, ArrayField):
            yield from (extent for extent in field.extents if isinstance(extent, str))


def check_array(label: str, field: ArrayField, value: object) -> npt.NDArray[Any]:
    """Return ``value`` if it is an array that is valid for ``field``.

    Raises TypeError: not an array, or another dtype. Raises ValueError: another number of dimensions or fixed extent,
    not contiguous, or not aligned.
    """
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{label}: expected a {field}, got {type(value).__name__}")
    if value.dtype != np.dtype(field.dtype) or not value.dtype.isnative:
        raise TypeError(f"{label}: expected a {field}, got {value.dtype} {value.shape}")
    fits = value.ndim == len(field.extents) and all(
        isinstance(wanted, str) or wanted == extent for wanted, extent in zip(field.extents, value.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{label}: expected a {field}, got shape {value.shape}")
    if not (value.flags.c_contiguous and value.flags.aligned):
        raise ValueError(f"{label}: expected a C-contiguous, aligned array, got strides {value.strides}")
    return value
