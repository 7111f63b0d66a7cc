"""Kernels are lowered without what only counted references need, and the pipeline without what only people read."""

from __future__ import annotations

import functools
from types import CodeType
from typing import Any

from numba.core import ir_utils, lowering
from numba.core.compiler import DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, PassManager, register_pass
from numba.core.errors import new_error_context  # type: ignore[attr-defined]
from numba.core.typed_passes import (
    AnnotateTypes,
    BaseNativeLowering,
    IRLegalization,
    NativeLowering,
    NopythonRewrites,
)
from numba.core.untyped_passes import InlineClosureLikes

from services.mechanics.compiled.aggregate import Aggregate


class _Lower(lowering.Lower):  # type: ignore[misc]  # numba has no types
    """A variable is not read before it is written, only to give up what it held."""

    def storevar(self, value: Any, name: str, argidx: int | None = None) -> None:
        """Write a variable."""
        if self.context.enable_nrt or self.flags.debuginfo or name in self._singly_assigned_vars:
            super().storevar(value, name, argidx)
            return
        self._alloca_var(name, self.typeof(name))
        self.builder.store(value, self.getvar(name))

    def lower_expr(self, resty: Any, expr: Any) -> Any:
        """Return the value of an expression; parts of a pair are taken out of it, not out of a copy in memory."""
        if expr.op not in ("pair_first", "pair_second") or self.context.enable_nrt:
            return super().lower_expr(resty, expr)
        pair = Aggregate(self.context, self.builder, self.typeof(expr.value.name), self.loadvar(expr.value.name))
        return pair.part(expr.op.removeprefix("pair_"))


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(BaseNativeLowering):  # type: ignore[misc]
    _name = "lowering_of_kernels"

    @property
    def lowering_class(self) -> type[_Lower]:
        return _Lower


@register_pass(mutates_CFG=False, analysis_only=True)
class _Legalisation(AnalysisPass):  # type: ignore[misc]
    """Ends of variables are not looked for: they are where references are given back."""

    _name = "legalisation_of_kernels"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        if state.flags.nrt or state.func_ir.is_generator:
            ir_utils.check_and_legalize_ir(state.func_ir, flags=state.flags)
        else:
            ir_utils.enforce_no_phis(state.func_ir)
        return True


class _Passes(PassManager):  # type: ignore[misc]
    """Runs passes, and nobody is told of each: numba writes a text of types and options for whoever may listen."""

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:
        pss.analysis = self._analysis
        with new_error_context("Pass {name}", name=pss.name()):
            pss.run_pass(internal_state)


def passes(state: Any) -> PassManager:
    """Return numba's passes for a kernel, but for those that find nothing in it."""
    has_closures = any(isinstance(each, CodeType) for each in state.func_id.code.co_consts)
    return _passes(has_closures, bool(state.flags.nrt))


@functools.cache
def _passes(has_closures: bool, may_allocate: bool) -> PassManager:
    """Return the passes, one for all such kernels, as it keeps nothing of a kernel."""
    from numba.core.compiler import Flags, StateDict

    usual = DefaultPassBuilder.define_nopython_pipeline(StateDict(flags=Flags(), func_ir=None))
    left_out = {AnnotateTypes}
    if not has_closures:
        left_out.add(InlineClosureLikes)
    if not may_allocate:
        left_out.add(NopythonRewrites)  # of expressions that make arrays
    passes = _Passes("kernel")
    ours = {NativeLowering: _Lowering, IRLegalization: _Legalisation}
    passes.passes = [(ours.get(each, each), what) for each, what in usual.passes if each not in left_out]
    passes.finalize()
    return passes
