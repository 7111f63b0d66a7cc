"""Small kernels that only kernels call have no machine code: they are optimised, kept, and linked into callers.

numba links the optimised code of a callee into its caller, optimises the whole anew and makes machine code of it, which
for nine kernels of ten nobody runs: of 500 kernels of the default scene Python calls 50. Most of the others are only
simplified, and optimised within their callers; those of detection are optimised by themselves, each once. Large ones
are machine code that all callers share (`apart.py`).
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from typing import Any

from llvmlite import binding as llvm
from llvmlite import ir
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompilerBase

from services.mechanics.compiled import apart
from services.mechanics.compiled.lowering import passes

_ENVIRONMENT = "_ZN08NumbaEnv"

#: What is used of numba here has no public name. Where another version lacks it, kernels are compiled in the usual way.
_ANOTHER_NUMBA = (AttributeError, TypeError)


#: Instructions of a kernel, with all that is linked into it, beyond which it is called and not linked.
_INLINED = 300


class _LinkedLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code for callers; what machine code is made of is a stub, the place of the function's environment alone.

    numba keeps both on disk, as of every kernel, and a process that reads them cannot tell the difference. numba would
    also link all that is called, at every depth, and optimise it once more with each caller, and theirs. Here what is
    too large to be inlined has machine code of its own, and callers find nothing to link.
    """

    _final_module: Any
    _linked: Any = None
    _name_apart: str | None = None

    @classmethod
    def of(cls, state: Any) -> _LinkedLibrary:
        """Return the library of the kernel that is compiled, which is to be kept on disk."""
        library = cls(state.targetctx.codegen(), state.func_id.func_qualname)
        library.enable_object_caching()
        return library

    def _optimize_final_module(self) -> None:
        self._optimise()

    def _optimise(self) -> None:
        super()._optimize_final_module()
        if self._name_apart is None:
            self._name_apart = _name_if_large(self._final_module)

    def _finalize_final_module(self) -> None:
        with contextlib.suppress(*_ANOTHER_NUMBA):
            self._separate()
        super()._finalize_final_module()

    def _separate(self) -> None:
        """Keep the code for callers, and put the stub in its place; if a part of numba is missing, neither."""
        _ = super()._get_module_for_linking
        module, name = self._final_module, self._name_apart
        stub = _stub(self._codegen, self.name, module, places=name is None)
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        if name is None:
            self._linked = _for_linking(module)
        else:
            nothing = llvm.parse_assembly(str(self._codegen._create_empty_module(self.name)))  # noqa: SLF001
            library = JITCodeLibrary(self._codegen, name)
            self._reload_init.add(apart.make(library, module, name, self._reload_init, nothing.clone()))
            self._linked = nothing
        self._final_module = stub

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
            self._name_apart = _name_if_large(self._final_module)
            if self._name_apart is not None:
                super()._optimise()


class KernelCompiler(CompilerBase):  # type: ignore[misc]  # numba has no types
    """The usual compiler, with fewer passes: for `njit`'s option ``pipeline_class``."""

    def define_pipelines(self) -> list[Any]:
        """Return the passes for kernels."""
        return [passes(self.state)]


class CallbackCompiler(Compiler):  # type: ignore[misc]
    """The usual compiler for a callback of C, which is kept with the machine code that it calls.

    numba links a callback when it has asked already what must be here before it is read from disk.
    """

    def compile_extra(self, function: Any) -> Any:
        """Compile it; return the result, which names the machine code."""
        result = super().compile_extra(function)
        with contextlib.suppress(*_ANOTHER_NUMBA):
            result.library._ensure_finalized()  # noqa: SLF001
            result.reload_init.extend(result.library._reload_init)  # noqa: SLF001
        return result


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


def _name_if_large(module: Any) -> str | None:
    """Return the name of a module's own function if it is too large to be inlined as a whole."""
    is_large = sum(1 for _ in itertools.islice(_instructions(module), _INLINED + 1)) > _INLINED
    return apart.own_function(module) if is_large else None


def _instructions(module: Any) -> Iterator[Any]:
    defined = (function for function in module.functions if not function.is_declaration)
    return (each for function in defined for block in function.blocks for each in block.instructions)


def _for_linking(module: Any) -> Any:
    """Return a module whose functions callers may define too: each has its own copy."""
    for function in module.functions:
        if not function.is_declaration and function.linkage == llvm.Linkage.external:
            function.linkage = llvm.Linkage.linkonce_odr
    return module


def _stub(codegen: Any, name: str, module: Any, *, places: bool) -> Any:
    """Return a module that has nothing but the environments of `module`, and their places or not."""
    stub = codegen._create_empty_module(name)  # noqa: SLF001
    for variable in module.global_variables:
        if variable.name.startswith(_ENVIRONMENT) and not variable.is_declaration:
            place = ir.GlobalVariable(stub, ir.IntType(8).as_pointer(), variable.name)
            if places:
                place.linkage, place.initializer = "common", ir.Constant(place.value_type, None)
    parsed = llvm.parse_assembly(str(stub))
    parsed.name = module.name
    return parsed
