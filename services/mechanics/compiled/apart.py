"""Machine code that several kernels call: made once, kept beside each of them, read once in a process.

numba links what a kernel calls into it: each kernel that Python calls had a copy of all of it, eight of them the
catheter's matrix. What is too large to be inlined is called all the same where it lies.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from llvmlite import binding as llvm
from numba.core.registry import cpu_target

#: By the name of their function, what this process has: machine code lives as long as the process.
_HERE: dict[str, Any] = {}


class MachineCode:
    """Machine code of one function.

    numba keeps it with each kernel that calls it (as `reload_init`), and calls it before it reads one of these.

    Parameters
    ----------
    name
        Of the function, which no other process gives (`names.py`).
    state
        As numba keeps a library on disk.
    called
        Machine code that it calls.
    """

    def __init__(self, name: str, state: Any, called: Iterable[MachineCode]) -> None:
        self.name, self._state, self._called = name, state, tuple(called)

    def __call__(self) -> None:
        """Make it known to what is read or compiled next in this process."""
        if self.name not in _HERE:
            for each in self._called:
                each()
            _HERE[self.name] = cpu_target.target_context.codegen().unserialize_library(self._state)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MachineCode) and other.name == self.name

    def __hash__(self) -> int:
        return hash(self.name)


def own_function(module: Any) -> str | None:
    """Return the name of the one function of a module that is not a copy; None if there is none, or several."""
    own = [each.name for each in module.functions if not each.is_declaration and each.linkage == llvm.Linkage.external]
    return own[0] if len(own) == 1 else None


def make(library: Any, module: Any, name: str, called: Iterable[Any], nothing: Any) -> MachineCode:
    """Return machine code of an optimised module, which is then here.

    Parameters
    ----------
    library
        A new one, which will be the module's.
    module
        What to make machine code of.
    name
        Of its function.
    called
        What numba calls before it reads a kernel that has this in it.
    nothing
        A module for callers to link: an empty one.
    """
    library.enable_object_caching()
    library._final_module = module  # noqa: SLF001
    library._finalize_final_module()  # noqa: SLF001
    library._shared_module = nothing  # noqa: SLF001
    _HERE[name] = library
    needed = (each for each in called if isinstance(each, MachineCode))
    return MachineCode(name, library.serialize_using_object_code(), needed)
