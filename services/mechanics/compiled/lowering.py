"""Kernels are lowered without what only counted references need, and the pipeline without what only people read."""

from __future__ import annotations

import functools
from typing import Any

from numba.core import ir_utils, lowering
from numba.core.compiler import DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, PassManager, register_pass
from numba.core.typed_passes import AnnotateTypes, BaseNativeLowering, IRLegalization, NativeLowering

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


@functools.cache
def passes() -> PassManager:
    """Return numba's passes for kernels; one for all of them, as it keeps nothing of a kernel but times."""
    from numba.core.compiler import Flags, StateDict

    usual = DefaultPassBuilder.define_nopython_pipeline(StateDict(flags=Flags(), func_ir=None))
    passes = PassManager("kernel")
    ours = {NativeLowering: _Lowering, IRLegalization: _Legalisation}
    passes.passes = [(ours.get(each, each), what) for each, what in usual.passes if each is not AnnotateTypes]
    passes.finalize()
    return passes
