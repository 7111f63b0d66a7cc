"""Calls of C functions by address, and a memory fence, for kernels without the interpreter or its lock.

Addresses are arguments and not part of the code, so that compiled code can be cached on disk.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_LONG, _UNSIGNED, _VOID = ir.IntType(64), ir.IntType(32), ir.VoidType()
#: HDErrorInfo, twelve bytes by value: x86-64 and AArch64 return them in two registers, as LLVM does this.
_ERROR_INFO = ir.LiteralStructType((_LONG, _UNSIGNED))


def _call(builder: Any, result: Any, arguments: tuple[Any, ...], values: Any) -> Any:
    """Emit a call of the function at ``values[0]`` with the other values; integers are truncated to the C types."""
    kind = ir.FunctionType(result, arguments)
    function = builder.inttoptr(values[0], kind.as_pointer())
    cut = [v if a == _LONG else builder.trunc(v, a) for v, a in zip(values[1:], arguments, strict=True)]
    return builder.call(function, cut)


def _call_unsigned(_context: Any, address: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        _call(builder, _VOID, (_UNSIGNED,), values)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


def _call_unsigned_pointer(_context: Any, address: Any, value: Any, pointer: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        _call(builder, _VOID, (_UNSIGNED, _LONG), values)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), generate


def _ask_unsigned(_context: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.zext(_call(builder, _UNSIGNED, (), values), _LONG)

    return types.int64(types.int64), generate


def _take_error(_context: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        info = _call(builder, _ERROR_INFO, (), values)
        code = builder.and_(builder.extract_value(info, 0), _LONG(0xFFFFFFFF))
        handle = builder.zext(builder.extract_value(info, 1), _LONG)
        return context.make_tuple(builder, signature.return_type, (code, handle))

    return types.UniTuple(types.int64, 2)(types.int64), generate


def _fence(_context: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        builder.fence("seq_cst")
        return context.get_dummy_value()

    return types.void(), generate


def _claim(_context: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flag = builder.inttoptr(values[0], _LONG.as_pointer())
        before = builder.atomic_rmw("xchg", flag, _LONG(1), "seq_cst")
        return builder.icmp_signed("==", before, _LONG(0))

    return types.boolean(types.int64), generate


#: ``void f(unsigned)`` at an address.
call_unsigned = cast(Callable[[int, int], None], intrinsic(_call_unsigned))
#: ``void f(unsigned, T *)``; the pointer is an address too. Also ``clock_gettime``, whose result is ignored.
call_unsigned_pointer = cast(Callable[[int, int, int], None], intrinsic(_call_unsigned_pointer))
#: ``unsigned f(void)``.
ask_unsigned = cast(Callable[[int], int], intrinsic(_ask_unsigned))
#: ``HDErrorInfo f(void)``: code and handle of the device.
take_error = cast(Callable[[int], tuple[int, int]], intrinsic(_take_error))
#: Full memory fence: other threads see earlier writes before later ones.
fence = cast(Callable[[], None], intrinsic(_fence))
#: Set the integer at an address to 1; return whether it was 0: of several threads only one gets True.
claim = cast(Callable[[int], bool], intrinsic(_claim))
