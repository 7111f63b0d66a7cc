"""A kernel that calls one of several by a number: a switch where it is called, not a function to be compiled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def one_of(kernels: Sequence[Callable[..., Any]]) -> Callable[..., Any]:
    """Make a kernel (number, ...) that hands the other arguments to the kernel with that number; for kernels to call.

    All take the same arguments and return the same kind of value. A number that none has means the last.
    """

    @intrinsic
    def choose(typing: Any, number: Any, *arguments: Any) -> Any:
        callees = [typing.resolve_value_type(each) for each in kernels]
        signatures = [typing.resolve_function_type(each, arguments, {}) for each in callees]
        returned = typing.unify_types(*(each.return_type for each in signatures))
        packed = types.Tuple(arguments)

        def generate(context: Any, builder: Any, _signature: Any, given: Any) -> Any:
            values = [builder.extract_value(given[1], k) for k in range(len(arguments))]
            calls = [
                partial(_call, context, builder, callee, wanted, values, arguments, returned)
                for callee, wanted in zip(callees, signatures, strict=True)
            ]
            return _switch(builder, given[0], calls)

        return returned(number, packed), generate

    chosen: Callable[..., Any] = choose
    return chosen


def _call(
    context: Any,
    builder: Any,
    callee: Any,
    signature: Any,
    values: Sequence[Any],
    kinds: Sequence[Any],
    returned: Any,
) -> Any:
    """Emit the call of a kernel with values of these kinds; return its own, of the kind that is returned."""
    taken = zip(values, kinds, signature.args, strict=True)
    given = [context.cast(builder, value, kind, wanted) for value, kind, wanted in taken]
    value = context.get_function(callee, signature)(builder, given)
    return context.cast(builder, value, signature.return_type, returned)


def _switch(builder: Any, number: Any, cases: Sequence[Callable[[], Any]]) -> Any:
    """Emit one of the cases by a number, the last for all others; return its value."""
    blocks = [builder.append_basic_block("case") for _ in cases]
    end = builder.append_basic_block("end")
    switch = builder.switch(number, blocks[-1])
    ends = []
    for k, (block, emit) in enumerate(zip(blocks, cases, strict=True)):
        if block is not blocks[-1]:
            switch.add_case(ir.Constant(number.type, k), block)
        builder.position_at_end(block)
        value = emit()
        ends.append((value, builder.block))
        builder.branch(end)
    builder.position_at_end(end)
    chosen = builder.phi(ends[0][0].type)
    for value, block in ends:
        chosen.add_incoming(value, block)
    return chosen
