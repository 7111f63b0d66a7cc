"""Decorators that compile the functions of a tick: numba's `njit`, cached on disk, without the interpreter's lock.

Argument types of kernels are described in `docs/reference/kernels.md`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from numba import cfunc, config, njit, types
from numba.extending import models, register_model, typeof_impl

F = TypeVar("F", bound=Callable[..., Any])

#: All kernels of the modules imported so far, for code that counts or checks them.
KERNELS: list[Any] = []

#: Where numba looks for a compiled kernel of ours: a class that numba imports by its name. Other functions are none of
#: its business, and it says so: for them numba goes on to its own.
_LOCATORS = (
    "trocar.services.kernels.kernel_cache.Locator,UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,"
    "IPythonCacheLocator"
)
_setting = threading.Lock()

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
    with _located():
        compiled: F = njit(cache=True, nogil=True)(function)
    return compiled


def callback(signature: Any, function: Callable[..., Any]) -> Any:
    """Compile a function that a C library calls, and may call kernels; return numba's `CFunc`, compiled."""
    with _located():
        return cfunc(signature, cache=True, nopython=True, error_model="numpy")(function)


def _compiled(function: F, **options: Any) -> F:
    with _located():
        compiled: F = njit(**options)(function)
    KERNELS.append(compiled)
    return compiled


@contextmanager
def _located() -> Iterator[None]:
    """Let numba ask our locator for what is decorated meanwhile; its settings are those of whoever imports us."""
    with _setting:
        before = config.CACHE_LOCATOR_CLASSES
        config.CACHE_LOCATOR_CLASSES = before or _LOCATORS
        try:
            yield
        finally:
            config.CACHE_LOCATOR_CLASSES = before


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
