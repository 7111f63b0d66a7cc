"""How the functions of a tick are compiled, and how they are handed what they work on.

Two costs are avoided here. Within machine code, arrays handed from function to function are descriptors of ten words
with a reference count: two dozen of them cost ten times the geometry (590 ns to touch a triangle). So collision
detection works on structs of addresses, handed on by reference, and everything is compiled without numba's runtime
(touching a triangle: 9 ns); without the runtime a kernel that would allocate, even a hidden copy, does not compile.

From Python into machine code, numba asks every argument for its type: 1.8 us for a struct, 1.5 us for a named tuple
of twenty arrays, 0.1 us for an integer. So a kernel that Python calls in every tick takes *addresses*, and
finds struct or tuple behind them with a reader made by `struct_reader` or `tuple_reader`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt
from numba import from_dtype, njit, typeof, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj

import services.mechanics.compiled.struct_type  # noqa: F401 - before the function of the same name below
from services.mechanics.arrays import LongArray

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T", bound=tuple[Any, ...])


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


def struct_reader(layout: np.dtype[np.void]) -> Callable[[int], Struct]:
    """Make a function for kernels that turns the address of a struct into the struct."""
    record = from_dtype(layout)

    @intrinsic
    def at(_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return record(address), generate

    reader: Callable[[int], Struct] = at
    return reader


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


def tuple_table(arrays: tuple[Any, ...]) -> LongArray:
    """Return addresses and shapes of the arrays of a (nested, named) tuple, and its numbers, for a `tuple_reader`.

    The caller keeps table and arrays alive; its address is what kernels are handed.

    Raises
    ------
    ValueError
        An array is not C-contiguous.
    """
    return np.array(list(_words(arrays)), np.int64)


def _words(value: Any) -> Iterator[int]:
    if isinstance(value, tuple):
        for member in value:
            yield from _words(member)
    elif isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise ValueError(f"an array of shape {value.shape} is not C-contiguous")
        yield from (value.ctypes.data, *value.shape)
    elif isinstance(value, float):
        yield int(np.float64(value).view(np.int64))
    else:
        yield int(value)


class Placed(Generic[T]):
    """A tuple of arrays with the address at which kernels find it; keeps what is there alive.

    Attributes
    ----------
    arrays : T
    address : int
    """

    def __init__(self, arrays: T) -> None:
        self.arrays = arrays
        self._table = tuple_table(arrays)
        self.address: int = self._table.ctypes.data


def tuple_reader(example: T) -> Callable[[int], T]:
    """Make a function for kernels that turns the address of a `tuple_table` into tuples of ``example``'s type."""
    kind = typeof(example)

    @intrinsic
    def at(_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            base = builder.inttoptr(arguments[0], cgutils.intp_t.as_pointer())
            words = (builder.load(cgutils.gep_inbounds(builder, base, k)) for k in range(_n_words(kind)))
            return _rebuild(context, builder, kind, words)

        return kind(address), generate

    reader: Callable[[int], T] = at
    return reader


def _n_words(kind: Any) -> int:
    if isinstance(kind, types.BaseTuple):
        return sum(_n_words(member) for member in kind.types)
    return 1 + kind.ndim if isinstance(kind, types.Array) else 1


def _rebuild(context: Any, builder: Any, kind: Any, words: Iterator[Any]) -> Any:
    """Emit code that makes a value of type ``kind`` from the words of a table."""
    if isinstance(kind, types.BaseTuple):
        members = [_rebuild(context, builder, member, words) for member in kind.types]
        return context.make_tuple(builder, kind, members)
    if isinstance(kind, types.Float):
        return builder.bitcast(next(words), context.get_value_type(kind))
    if not isinstance(kind, types.Array):
        return next(words)
    array = arrayobj.make_array(kind)(context, builder)
    data = builder.inttoptr(next(words), array.data.type)
    shape = [next(words) for _ in range(kind.ndim)]
    item_bytes = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    strides = [item_bytes]
    for extent in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], extent))
    arrayobj.populate_array(
        array, data=data, shape=shape, strides=strides, itemsize=item_bytes, meminfo=None, parent=None
    )
    return array._getvalue()  # noqa: SLF001 - the proxy has no public way to its value
