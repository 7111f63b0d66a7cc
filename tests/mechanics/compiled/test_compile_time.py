"""What numba is asked again and again while it compiles is remembered, and forgets nothing that makes a difference."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from llvmlite.binding import ffi
from numba import types
from numba.core import base
from numba.core.compiler import Flags
from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction

from services.mechanics.compiled import compile_time, kernel


class _Function:
    """An operator with an implementation of its own for each option; counts who asks."""

    def __init__(self) -> None:
        self._impl_keys: dict[Any, str] = {}
        self.asked = 0

    def resolve(self, _context: object, arguments: tuple[Any, ...], _keywords: object) -> SimpleNamespace | None:
        self.asked += 1
        if not arguments:
            return None
        flags = ConfigStack.top_or_none()
        self._impl_keys[arguments] = "fast" if flags is not None and flags.nrt else "plain"
        return SimpleNamespace(args=arguments)


def _ask(ask: Any, function: _Function, arguments: tuple[Any, ...], keywords: dict[str, Any], *, nrt: bool) -> Any:
    flags = Flags()
    flags.nrt = nrt
    with ConfigStack().enter(flags):
        return ask(function, None, arguments, keywords)


def test_a_signature_is_resolved_once_for_types_and_options() -> None:
    ask, function = compile_time._Remembered(_Function.resolve).ask(), _Function()
    first = _ask(ask, function, (types.int64,), {}, nrt=False)
    assert _ask(ask, function, (types.int64,), {}, nrt=False) is first
    assert function.asked == 1
    assert _ask(ask, function, (types.float64,), {}, nrt=False).args == (types.float64,)
    assert function.asked == 2


def test_other_options_have_an_implementation_of_their_own_whoever_asked_last() -> None:
    """Of two kernels one may reorder its sums: neither gets what was compiled for the other."""
    ask, function, given = compile_time._Remembered(_Function.resolve).ask(), _Function(), (types.float64,)
    for nrt, implementation in ((False, "plain"), (True, "fast"), (False, "plain"), (True, "fast")):
        _ask(ask, function, given, {}, nrt=nrt)
        assert function._impl_keys[given] == implementation
    assert function.asked == 2


def test_keywords_and_what_cannot_be_called_so_are_asked_for_each_time() -> None:
    ask, function = compile_time._Remembered(_Function.resolve).ask(), _Function()
    for _ in range(2):
        _ask(ask, function, (types.int64,), {"axis": types.int64}, nrt=False)
        assert _ask(ask, function, (), {}, nrt=False) is None
    assert function.asked == 4


def test_arguments_in_a_list_are_asked_for_each_time() -> None:
    """As numba's stencils give them, whoever uses one in this process."""
    ask, asked = compile_time._Remembered(lambda *all_of_it: all_of_it).ask(), [types.int64, types.intp]
    assert ask("function", None, asked, {}) == ("function", None, asked, {})


@kernel
def _many_products(x: float) -> float:
    return x * x * x * x * x * x


def test_this_numba_is_spared_both() -> None:
    """Fails with a numba that has other parts: then a cold start takes longer, and nothing else is wrong."""
    assert BaseFunction.get_call_type.__module__ == compile_time.__name__
    assert all(taken.__module__ != base.__name__ for taken, _ in ffi.lib._lock._cblist)
    assert _many_products(2.0) == 64.0
