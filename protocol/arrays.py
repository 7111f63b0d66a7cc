"""Numeric arrays on the wire: ``[dtype, shape, bin]``, checked against what the body declares.

A body declares an array field as ``Annotated[Array, spec("<f8", ("particles", 3), "m")]``: the numpy dtype string, a
shape whose entries are a number or the name of a dimension, and the unit. One name is one length in all arrays of a
body, so a body whose arrays disagree is refused before anyone indexes with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import prod
from typing import Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

MAX_DIMENSION = 1 << 20  # as no frame has more bytes (`frame.MAX_FRAME_BYTES`)


class Array(msgspec.Struct, array_like=True, frozen=True, gc=False):
    """A numeric array as it travels: little-endian, C order."""

    dtype: str
    shape: tuple[int, ...]
    data: bytes

    def view(self) -> NDArray[Any]:
        """Return the array, read-only, without a copy. Call only on a checked body: the bytes are trusted here."""
        return np.frombuffer(self.data, _dtype(self.dtype)).reshape(self.shape)


@cache
def _dtype(name: str) -> np.dtype[Any]:
    return np.dtype(name)


def pack(values: ArrayLike, dtype: str = "<f8") -> Array:
    """Return `values` as a wire array of `dtype`; copies once into bytes."""
    array = np.ascontiguousarray(values, dtype=dtype)
    return Array(dtype, array.shape, array.tobytes())


@dataclass(frozen=True, slots=True)
class Spec:
    """What a body declares of an array field: dtype, shape, unit, whether it must be finite, and of a table the type of
    its rows (`trocar.protocol.table.TableRow`), whose names are the columns'.
    """

    dtype: str
    shape: tuple[int | str, ...]
    unit: str
    finite: bool = True
    row: type[msgspec.Struct] | None = None

    @property
    def must_be_finite(self) -> bool:
        """Whether there are numbers in it that could be none."""
        return self.finite and self.dtype == "<f8"

    def fault(self, array: Array, lengths: dict[str, int]) -> tuple[str, str] | None:
        """Return ``(reason, detail)`` if `array` breaks the declaration, else None; binds names in `lengths`."""
        if array.dtype != self.dtype:
            return "array_dtype", f"dtype {array.dtype[:8]!r}, declared {self.dtype!r}"
        if len(array.shape) != len(self.shape):
            return "array_shape", f"{len(array.shape)} dimensions, declared {len(self.shape)}"
        for length, declared in zip(array.shape, self.shape, strict=True):
            expected = lengths.setdefault(declared, length) if isinstance(declared, str) else declared
            if length != expected or not 0 <= length <= MAX_DIMENSION:
                return "array_shape", f"shape {array.shape}, declared {self.shape}"
        if prod(array.shape) * int(self.dtype[2:]) != len(array.data):
            return "array_shape", f"{len(array.data)} bytes for shape {array.shape} of {self.dtype}"
        if self.must_be_finite and not np.isfinite(np.frombuffer(array.data)).all():
            return "not_finite", "an array holds NaN or infinity"
        return None


def spec(
    dtype: str, shape: tuple[int | str, ...], unit: str, *, finite: bool = True, row: type[msgspec.Struct] | None = None
) -> Meta:
    """Return what makes an `Array` field say what it holds; see `Spec`."""
    return Meta(extra={"array": Spec(dtype, shape, unit, finite, row)})
