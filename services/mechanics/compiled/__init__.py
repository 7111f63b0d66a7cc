"""Decorators that compile the functions of a tick: numba's `njit`, cached on disk, without the interpreter's lock.

Argument types of kernels are described in `docs/reference/kernels.md`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import cfunc, njit

F = TypeVar("F", bound=Callable[..., Any])

#: All kernels of the modules imported so far, for code that counts or checks them.
KERNELS: list[Any] = []

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}


def kernel(function: F) -> F:
    """Compile a function that runs in a tick; decorator. It must not allocate, which a test checks."""
    return _compiled(function, **_OPTIONS)


def inlined_kernel(function: F) -> F:
    """Compile a part of one long kernel only as part of it, not by itself; decorator.

    It must have a single caller, because each gets its own copy.
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
