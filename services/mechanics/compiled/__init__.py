"""Decorators that compile the functions of a tick: numba's `njit`, cached on disk, without the interpreter's lock.

Argument types of kernels are described in `docs/reference/kernels.md`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any, TypeVar, cast

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
    if "inline" not in options:
        _INNER[compiled] = functools.cache(lambda: _inner_type(cast(FunctionType, function), options))
    return compiled


#: Of each kernel: what returns its type where kernels call it.
_INNER: dict[Any, Callable[[], types.Type]] = {}


class _InnerType(types.Dispatcher):  # type: ignore[misc]  # numba has no types
    """A kernel that kernels call: each constant, and each size of an integer, would be a type of its own."""

    def get_call_type(self, context: Any, arguments: Sequence[types.Type], keywords: dict[str, types.Type]) -> Any:
        """Return the signature of a call, compiled for any value."""
        return super().get_call_type(context, tuple(map(_plain, arguments)), keywords)


register_model(_InnerType)(models.OpaqueModel)


def _plain(kind: types.Type) -> types.Type:
    kind = types.unliteral(kind)
    return types.int64 if isinstance(kind, types.Integer) and kind.signed else kind


def _inner_type(function: FunctionType, options: dict[str, Any]) -> types.Type:
    """Compile a copy that Python cannot call, as taking arguments from Python's objects is a fifth of all code.

    It has a name of its own, by which numba keeps it on disk.
    """
    copy = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    copy.__kwdefaults__, copy.__module__ = function.__kwdefaults__, function.__module__
    copy.__qualname__ = f"{function.__qualname__}.inner"
    KERNELS.append(njit(no_cpython_wrapper=True, **options)(copy))
    return _InnerType(KERNELS[-1])


@typeof_impl.register(type(njit(lambda: None)))
def _typeof(dispatcher: Any, _context: Any) -> types.Type:
    """Return the type by which kernels know a kernel."""
    inner = _INNER.get(dispatcher)
    return types.Dispatcher(dispatcher) if inner is None else inner()
