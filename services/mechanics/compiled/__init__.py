"""How the functions of a tick are compiled: without numba's runtime, kept on disk, without the interpreter's lock.

Without the runtime a kernel that would allocate, even a hidden copy, does not compile, and no array that is handed on
counts references (`docs/decisions/kernels-without-runtime.md`). What kernels are handed: `docs/kernels.md`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a function that runs in a tick; decorator."""
    compile_it = njit(cache=True, nogil=True, fastmath=False, error_model="numpy", _nrt=False)
    compiled: F = compile_it(function)
    return compiled


def made_kernel(function: F) -> F:
    """Compile a kernel that another function makes, once for each table or the like; decorator.

    All those made in one place have one name, so none is kept on disk by itself: each is part of its callers.
    """
    compile_it = njit(nogil=True, fastmath=False, error_model="numpy", _nrt=False)
    compiled: F = compile_it(function)
    return compiled


def summing_kernel(function: F) -> F:
    """Compile a long sum in vectorised parts: only the order of its terms is left to the compiler; decorator."""
    compile_it = njit(cache=True, nogil=True, fastmath={"reassoc"}, error_model="numpy", _nrt=False)
    compiled: F = compile_it(function)
    return compiled


def building_kernel(function: F) -> F:
    """Compile a function that prepares a scene and may allocate; decorator. No kernel of a tick calls it."""
    compile_it = njit(cache=True, nogil=True)
    compiled: F = compile_it(function)
    return compiled
