"""Kernels that are found on disk are read without what numba makes ready to compile one.

numba makes that ready before it looks whether a kernel is stored: modules are imported and thousands of
implementations put into tables, 0.2 s in each process. One that finds all its kernels compiles none; one that compiles
has it made ready then.
"""

from __future__ import annotations

from typing import Any

from numba.core.caching import FunctionCache
from numba.core.runtime import rtsys


def keep(dispatcher: Any, *, needs_runtime: bool = False) -> Any:
    """Let what is compiled of a dispatcher's function be stored, and found again; return the dispatcher.

    With `needs_runtime` it may allocate, and what that takes is there before it is read.
    """
    stored = _StoredWithRuntime if needs_runtime else _Stored
    dispatcher._cache = stored(dispatcher.py_func)  # noqa: SLF001 - as its `enable_caching` does
    return dispatcher


class _Stored(FunctionCache):  # type: ignore[misc]  # numba has no types
    """What is stored of one kernel."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the kernel for a signature, None if it is not stored."""
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target_context)
            if found is not None:
                found.library._reload_init.update(found.reload_init)  # noqa: SLF001 - as of one that is compiled here
            return found


class _StoredWithRuntime(_Stored):
    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the same, with numba's runtime to call."""
        rtsys.initialize(target_context)
        return super().load_overload(sig, target_context)
