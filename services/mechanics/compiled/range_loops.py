"""Loops over ``range`` in as few instructions as they need: numba writes ninety, of which ten are left once optimised.

Among them are the refusal of a step of zero and counts of steps that are no constants, where nearly all steps are one.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.cpython import rangeobj  # noqa: F401 - what it registers is replaced here, so it must have been first
from numba.extending import lower_builtin

from services.mechanics.compiled.aggregate import Aggregate

_INT = ir.IntType(64)
_RANGE, _ITERATOR = types.range_state64_type, types.range_iter64_type


def begin() -> None:
    """Lower ranges of 64 bits so in this process; once."""
    for n in (1, 2, 3):
        lower_builtin(range, *[types.int64] * n)(_range)
    lower_builtin("getiter", _RANGE)(_begin_loop)
    lower_builtin("iternext", _ITERATOR)(_next)


def _range(context: Any, builder: Any, _signature: Any, given: Any) -> Any:
    start, stop, step = {1: (_INT(0), *given, _INT(1)), 2: (*given, _INT(1)), 3: given}[len(given)]
    made = Aggregate(context, builder, _RANGE)
    for name, value in {"start": start, "stop": stop, "step": step}.items():
        made.put(name, value)
    return made.value


def _begin_loop(context: Any, builder: Any, _signature: Any, given: Any) -> Any:
    (value,) = given
    limits = Aggregate(context, builder, _RANGE, value)
    start, stop, step = limits.part("start"), limits.part("stop"), _known_step(value) or limits.part("step")
    here, left = (cgutils.alloca_once(builder, _INT) for _ in range(2))
    builder.store(start, here)
    builder.store(_count(context, builder, builder.sub(stop, start), step), left)
    made = Aggregate(context, builder, _ITERATOR)
    for name, part in {"iter": here, "stop": stop, "step": step, "count": left}.items():
        made.put(name, part)
    return made.value


def _known_step(value: Any) -> Any:
    """Return the step of a range if it is a constant that was put into it last, else None."""
    if isinstance(value, ir.instructions.InsertValue) and list(value.indices) == [2]:
        step = value.operands[1]
        return step if isinstance(step, ir.Constant) and step.constant else None
    return None


def _count(context: Any, builder: Any, way: Any, step: Any) -> Any:
    """Return how many steps lead over `way`; one of zero is refused as Python does."""
    zero, one = _INT(0), _INT(1)
    ahead = builder.icmp_signed(">", way, zero)
    if isinstance(step, ir.Constant) and step.constant == 1:
        return builder.select(ahead, way, zero)
    with cgutils.if_unlikely(builder, builder.icmp_unsigned("==", step, zero)):
        context.call_conv.return_user_exc(builder, ValueError, ("range() arg 3 must not be zero",))
    apart = builder.xor(ahead, builder.icmp_signed(">", step, zero))
    rest = builder.srem(way, step)
    uneven = builder.icmp_signed(">", builder.select(ahead, rest, builder.neg(rest)), zero)
    count = builder.add(builder.sdiv(way, step), builder.select(uneven, one, zero))
    return builder.select(apart, zero, count)


def _next(context: Any, builder: Any, signature: Any, given: Any) -> Any:
    """Return the next number, and whether there is one."""
    loop = Aggregate(context, builder, _ITERATOR, given[0])
    left, before = builder.load(loop.part("count")), builder.block
    there_is_one = builder.icmp_signed(">", left, _INT(0))
    with builder.if_then(there_is_one):
        value, within = builder.load(loop.part("iter")), builder.block
        builder.store(builder.sub(left, _INT(1), flags=["nsw"]), loop.part("count"))
        builder.store(builder.add(value, loop.part("step")), loop.part("iter"))
    number = builder.phi(_INT)
    number.add_incoming(_INT(0), before)
    number.add_incoming(value, within)
    pair = Aggregate(context, builder, signature.return_type)
    pair.put("first", number)
    pair.put("second", there_is_one)
    return pair.value
