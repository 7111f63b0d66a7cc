"""How the kernels of collision detection are compiled, and the C structs they are handed.

A surface is two dozen arrays. Handed from function to function as numpy arrays they cost ten times the geometry
(590 ns to touch a triangle): each is a descriptor of ten words with a reference count. So the kernels see one
struct of addresses, handed on by reference, and are compiled without numba's runtime (touching a triangle:
9 ns). Without the runtime a kernel that would allocate, even a hidden copy, does not compile at all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from numba import njit, types
from numba.extending import intrinsic

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a function that runs in a tick; decorator."""
    compile_it = njit(cache=True, nogil=True, fastmath=False, error_model="numpy", _nrt=False)
    compiled: F = compile_it(function)
    return compiled


def summing_kernel(function: F) -> F:
    """Compile a long sum in vectorised parts: only the order of its terms is left to the compiler; decorator."""
    compile_it = njit(cache=True, nogil=True, fastmath={"reassoc"}, error_model="numpy", _nrt=False)
    compiled: F = compile_it(function)
    return compiled


Struct = Any
"""A struct as the kernels see it: a numpy record passed by reference."""


def _pointer_reader(item: types.Type) -> Any:
    """Make a function for kernels that turns an address kept in a struct into a flat array of ``item``."""

    @intrinsic
    def at(_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return types.CPointer(item)(address), generate

    return at


floats = _pointer_reader(types.float64)
ints = _pointer_reader(types.int32)
longs = _pointer_reader(types.int64)
flags = _pointer_reader(types.int8)


def struct_type(arrays: Iterable[str], numbers: Iterable[str] = (), counts: Iterable[str] = ()) -> np.dtype[np.void]:
    """Return the layout of a struct: addresses of arrays, float64 numbers, int64 counts."""
    fields = [(name, "i8") for name in arrays] + [(name, "f8") for name in numbers]
    return np.dtype(fields + [(name, "i8") for name in counts], align=True)


def nest(**members: np.dtype[np.void]) -> np.dtype[np.void]:
    """Return the layout of a struct of structs."""
    return np.dtype(list(members.items()), align=True)


def fill(struct: Struct, **values: npt.NDArray[Any] | float) -> None:
    """Write numbers and the addresses of C-contiguous arrays into a struct.

    The caller keeps the arrays alive as long as the struct.
    """
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            if not value.flags.c_contiguous:
                raise ValueError(f"array '{name}' is not C-contiguous")
            struct[name] = value.ctypes.data
        else:
            struct[name] = value
