"""How the functions of a tick are compiled: without numba's runtime, kept on disk, without the interpreter's lock.

Without the runtime a kernel that would allocate, even a hidden copy, does not compile, and no array that is handed on
counts references (`docs/decisions/kernels-without-runtime.md`). What kernels are handed: `docs/kernels.md`.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any, TypeVar, cast

from numba import cfunc, njit

from services.mechanics.compiled import names
from services.mechanics.compiled.plain_types import plain

names.begin()

_USUAL: dict[str, Any] = {}
_CALLBACK: dict[str, Any] = {}
_LINKED: dict[str, Any] = {}
_SIMPLIFIED: dict[str, Any] = {}


def _store(dispatcher: Any, *, needs_runtime: bool = False) -> Any:
    dispatcher.enable_caching()
    return dispatcher


with contextlib.suppress(ImportError):
    from services.mechanics.compiled.stored import keep as _store
with contextlib.suppress(ImportError):  # of numba's compiler: without it, kernels are compiled in the usual way
    from services.mechanics.compiled.linked import (
        CallbackCompiler,
        KernelCompiler,
        LinkedCompiler,
        SimplifyingCompiler,
    )

    _USUAL, _CALLBACK = {"pipeline_class": KernelCompiler}, {"pipeline_class": CallbackCompiler}
    _LINKED, _SIMPLIFIED = {"pipeline_class": LinkedCompiler}, {"pipeline_class": SimplifyingCompiler}
with contextlib.suppress(ImportError):
    from services.mechanics.compiled import compile_time

    compile_time.begin()
with contextlib.suppress(ImportError):
    from services.mechanics.compiled import array_access, range_loops

    array_access.begin()
    range_loops.begin()

F = TypeVar("F", bound=Callable[..., Any])

#: No kernel is handed to others by its address, so none needs an entry for that.
_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
#: What kernels alone call is only simplified before it is linked, but for detection and its vectors: detection made so
#: was slower in the slowest hundredth of ticks (`docs/decisions/kernel-cache.md`).
_OPTIMISED_BY_THEMSELVES = ("services.mechanics.collision.", "services.mechanics.compiled.")


def kernel(function: F) -> F:
    """Compile a function that runs in a tick; decorator."""
    return _compiled(function, {**_OPTIONS, "fastmath": False})


def summing_kernel(function: F) -> F:
    """Compile a long sum in vectorised parts: only the order of its terms is left to the compiler; decorator."""
    return _compiled(function, {**_OPTIONS, "fastmath": {"reassoc"}})


def building_kernel(function: F) -> F:
    """Compile a function that prepares a scene and may allocate; decorator. No kernel of a tick calls it."""
    compiled: F = _store(njit(nogil=True)(function), needs_runtime=True)
    return compiled


def callback(signature: Any, function: Callable[..., Any]) -> Any:
    """Compile a function that a C library calls, and may call kernels; return numba's `CFunc`, compiled.

    numba's own `cfunc` alone must not be kept on disk here: it would not find the machine code of large kernels again.
    """
    return cfunc(signature, cache=True, nopython=True, error_model="numpy", **_CALLBACK)(function)


def _compiled(function: F, options: dict[str, Any]) -> F:
    """Return the function as Python calls it; kernels that call it are given a twin that Python cannot call.

    Nine kernels of ten are called by kernels only: these have neither what takes arguments from Python's objects, which
    is a fifth of what there is to compile, nor machine code of their own.
    """
    compiled = _store(njit(**_USUAL, **options)(function))

    @functools.cache
    def twin() -> Any:
        pipeline = _LINKED if function.__module__.startswith(_OPTIMISED_BY_THEMSELVES) else _SIMPLIFIED
        linked = njit(no_cpython_wrapper=True, **pipeline, **options)
        return _store(linked(_renamed(cast(FunctionType, function))))

    def call_template(args: Sequence[Any], keywords: dict[str, Any]) -> Any:
        return twin().get_call_template(tuple(map(plain, args)), {name: plain(kind) for name, kind in keywords.items()})

    compiled.get_call_template = call_template
    compiled.get_overload = lambda signature: twin().get_overload(signature)
    return cast(F, compiled)


def _renamed(function: FunctionType) -> FunctionType:
    """Return the same function under another name: the compiled ones are kept on disk by name."""
    twin = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    twin.__kwdefaults__ = function.__kwdefaults__
    twin.__module__ = function.__module__
    twin.__qualname__ = f"{function.__qualname__}.within_kernels"
    return twin
