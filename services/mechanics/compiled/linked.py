"""Kernels that only kernels call have no machine code of their own: they are optimised, kept, and linked into callers.

numba links the optimised code of a callee into its caller, optimises the whole anew and makes machine code of it, which
for nine kernels of ten nobody runs: of 500 kernels of the default scene Python calls 50. Most of the others are only
simplified, and optimised within those that Python calls. Those of detection are optimised by themselves, each once.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from typing import Any
from weakref import WeakKeyDictionary

from llvmlite import binding as llvm
from llvmlite import ir
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase

from services.mechanics.compiled.lowering import passes

_ENVIRONMENT = "_ZN08NumbaEnv"

#: What is used of numba here has no public name. Where another version lacks it, kernels are compiled in the usual way.
_ANOTHER_NUMBA = (AttributeError, TypeError)


#: Instructions of what is still inlined, with all that it calls: beyond them, nothing in detection is.
_INLINED = 1000
_SMALL: WeakKeyDictionary[Any, bool] = WeakKeyDictionary()


class _LinkedLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code for callers; what machine code is made of is a stub, the place of the function's environment alone.

    numba keeps both on disk, as of every kernel, and a process that reads them cannot tell the difference. numba would
    also link all that is called, at every depth, and optimise it once more with each caller, and theirs. Here what is
    too large to be inlined is linked when the rest has been optimised, as it was when its own turn came.
    """

    _final_module: Any
    _linking_libraries: list[Any]
    _linked: Any = None
    _large: tuple[Any, ...] = ()

    @classmethod
    def of(cls, state: Any) -> _LinkedLibrary:
        """Return the library of the kernel that is compiled, which is to be kept on disk."""
        library = cls(state.targetctx.codegen(), state.func_id.func_qualname)
        library.enable_object_caching()
        return library

    def finalize(self) -> None:
        """Link what is called, the large apart; optimise; make ready."""
        with contextlib.suppress(*_ANOTHER_NUMBA):
            self._set_apart()
        super().finalize()

    def _set_apart(self) -> None:
        called = list(dict.fromkeys(self._linking_libraries))
        large = [each for each in called if not _is_small(each)]
        modules = tuple(each._get_module_for_linking() for each in large)  # noqa: SLF001
        for each in large:
            self._reload_init.update(each._reload_init)  # noqa: SLF001
        self._linking_libraries = [each for each in called if each not in large]
        self._large = modules

    def _optimize_final_module(self) -> None:
        self._optimise()
        for module in self._large:
            self._final_module.link_in(module, preserve=True)

    def _optimise(self) -> None:
        super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        with contextlib.suppress(*_ANOTHER_NUMBA):
            self._separate()
        super()._finalize_final_module()

    def _separate(self) -> None:
        """Keep the code for callers, and put the stub in its place; if a part of numba is missing, neither."""
        _ = super()._get_module_for_linking
        stub = _stub(self._codegen, self.name, self._final_module)
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._linked, self._final_module = _for_linking(self._final_module), stub

    def _get_module_for_linking(self) -> Any:
        self._ensure_finalized()
        return super()._get_module_for_linking() if self._linked is None else self._linked


class _SimplifiedLibrary(_LinkedLibrary):
    """Code that is only simplified; optimised it would be unrolled and vectorised, and taken apart in each caller."""

    def _optimise(self) -> None:
        try:
            passes, options = self._codegen._module_pass_manager(  # noqa: SLF001
                loop_vectorize=False, slp_vectorize=False, opt=0, cost="cheap"
            )
        except _ANOTHER_NUMBA:
            super()._optimise()
        else:
            passes.run(self._final_module, options)


class KernelCompiler(CompilerBase):  # type: ignore[misc]  # numba has no types
    """The usual compiler, with fewer passes: for `njit`'s option ``pipeline_class``."""

    def define_pipelines(self) -> list[Any]:
        """Return the passes for kernels."""
        return [passes(self.state)]


class LinkedCompiler(KernelCompiler):
    """The same, which puts its code into a `_LinkedLibrary`."""

    _library: type[_LinkedLibrary] = _LinkedLibrary

    def define_pipelines(self) -> list[Any]:
        """Return the passes for kernels."""
        with contextlib.suppress(*_ANOTHER_NUMBA):
            self.state.library = self._library.of(self.state)
        return super().define_pipelines()


class SimplifyingCompiler(LinkedCompiler):
    """The same with a `_SimplifiedLibrary`: compiles in two thirds of the time."""

    _library = _SimplifiedLibrary


def _is_small(library: Any) -> bool:
    """Return whether what a library defines may be inlined as a whole."""
    if library not in _SMALL:
        instructions = _instructions(library._get_module_for_linking())  # noqa: SLF001
        _SMALL[library] = sum(1 for _ in itertools.islice(instructions, _INLINED + 1)) <= _INLINED
    return _SMALL[library]


def _instructions(module: Any) -> Iterator[Any]:
    defined = (function for function in module.functions if not function.is_declaration)
    return (each for function in defined for block in function.blocks for each in block.instructions)


def _for_linking(module: Any) -> Any:
    """Return a module whose functions callers may define too: each has its own copy."""
    for function in module.functions:
        if not function.is_declaration and function.linkage == llvm.Linkage.external:
            function.linkage = llvm.Linkage.linkonce_odr
    return module


def _stub(codegen: Any, name: str, module: Any) -> Any:
    """Return a module that defines nothing but the environments of `module`."""
    stub = codegen._create_empty_module(name)  # noqa: SLF001
    for variable in module.global_variables:
        if variable.name.startswith(_ENVIRONMENT) and not variable.is_declaration:
            place = ir.GlobalVariable(stub, ir.IntType(8).as_pointer(), variable.name)
            place.linkage, place.initializer = "common", ir.Constant(place.value_type, None)
    parsed = llvm.parse_assembly(str(stub))
    parsed.name = module.name
    return parsed
