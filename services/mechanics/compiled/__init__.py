"""Decorators that compile the functions of a tick: numba's `njit`, cached on disk, without the interpreter's lock.

Argument types of kernels are described in `docs/reference/kernels.md`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from numba import cfunc, njit, types
from numba.extending import models, register_model, typeof_impl

F = TypeVar("F", bound=Callable[..., Any])

#: All kernels of the modules imported so far, for code that counts or checks them.
KERNELS: list[Any] = []

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def kernel(function: F) -> F:
    """Compile a function that runs in a tick; decorator. It must not allocate, which a test checks."""
    return _compiled(function, **_OPTIONS)


def inlined_kernel(function: F) -> F:
    """Compile a kernel with a single caller only as part of it, not by itself, which takes longer; decorator.

    Each further caller would get its own copy.
    """
    return _compiled(function, **_OPTIONS, inline="always")


def summing_kernel(function: F) -> F:
    """Compile a long sum with vectorisation: only the order of terms is left to the compiler; decorator."""
    return _compiled(function, **_OPTIONS, fastmath={"reassoc"})


def building_kernel(function: F) -> F:
    """Compile a function that prepares a scene and may allocate; decorator. No kernel of a tick calls it."""
    compiled: F = njit(cache=True, nogil=True)(function)
    return compiled


def callback(signature: Any, function: Callable[..., Any]) -> Any:
    """Compile a function that a C library calls, and may call kernels; return numba's `CFunc`, compiled."""
    return cfunc(signature, cache=True, nopython=True, error_model="numpy")(function)


def _compiled(function: F, **options: Any) -> F:
    compiled: F = njit(**options)(function)
    KERNELS.append(compiled)
    return compiled


class _KernelType(types.Dispatcher):  # type: ignore[misc]  # numba has no types
    """The type of a kernel where kernels call it: numba's own compiles it again for each constant and integer type."""

    def get_call_type(self, context: Any, arguments: Sequence[types.Type], keywords: dict[str, types.Type]) -> Any:
        """Return the signature of a call, compiled for any value, and for int64 instead of other signed integers."""
        return super().get_call_type(context, tuple(map(_plain, arguments)), keywords)


register_model(_KernelType)(models.OpaqueModel)


def _plain(kind: types.Type) -> types.Type:
    kind = types.unliteral(kind)
    return types.int64 if isinstance(kind, types.Integer) and kind.signed else kind


@typeof_impl.register(type(njit(lambda: None)))
def _typeof(dispatcher: Any, _context: Any) -> types.Type:
    """Tell numba the type of a compiled function: ours of our kernels, numba's of all others."""
    return _KernelType(dispatcher) if dispatcher in KERNELS else types.Dispatcher(dispatcher)
