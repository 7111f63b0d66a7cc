"""The decorators that compile the functions of a tick: numba's `njit`, kept on disk, without the interpreter's lock.

What kernels take as arguments: `docs/reference/kernels.md`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import cfunc, njit

F = TypeVar("F", bound=Callable[..., Any])

#: Every kernel whose module this process has imported, for what counts or checks them all.
KERNELS: list[Any] = []

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}


def kernel(function: F) -> F:
    """Compile a function that runs in a tick; decorator. It must not allocate: a test looks for that."""
    return _compiled(function, **_OPTIONS)


def inlined_kernel(function: F) -> F:
    """Compile a long part of one kernel with that kernel only, not a second time by itself; decorator.

    It must have a single caller: each would have a copy of it.
    """
    return _compiled(function, **_OPTIONS, inline="always")


def summing_kernel(function: F) -> F:
    """Compile a long sum in vectorised parts: only the order of its terms is left to the compiler; decorator."""
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
