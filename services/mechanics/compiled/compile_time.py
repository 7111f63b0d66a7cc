"""Less of numba's own Python while it compiles: what it asks again and again is remembered, and nobody is told in vain.

Half of a cold compile is Python. What is replaced here has no public name; where another numba lacks it, nothing is.
"""

from __future__ import annotations

import contextlib
import functools
from typing import Any

from llvmlite.binding import ffi
from numba.core import base
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.targetconfig import ConfigStack
from numba.core.transforms import canonicalize_cfg
from numba.core.types.functions import BaseFunction

_RESOLVE = "get_call_type"
_TAKES_PLACE = "_has_loc"


def begin() -> None:
    """Spare this process both; once."""
    with contextlib.suppress(AttributeError):
        _call_nobody()
    with contextlib.suppress(AttributeError):
        setattr(BaseFunction, _RESOLVE, _Remembered(getattr(BaseFunction, _RESOLVE)).ask())
    with contextlib.suppress(AttributeError):
        _look_for_lifetimes_when_asked()
    with contextlib.suppress(AttributeError):
        setattr(base, _TAKES_PLACE, functools.lru_cache(maxsize=None)(getattr(base, _TAKES_PLACE)))


def _call_nobody() -> None:
    """Take numba's callbacks off llvmlite's lock: 900 events a kernel, told to a timer of each caller it has."""
    for taken, given_back in list(ffi.lib._lock._cblist):  # noqa: SLF001
        if taken.__module__ == base.__name__:
            ffi.unregister_lock_callback(taken, given_back)


def _look_for_lifetimes_when_asked() -> None:
    """Let numba find where variables begin and end where that is asked for: it did so nine times for each kernel."""
    at_once = PostProcessor.run

    def run(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        ir = self.func_ir
        if emit_dels or ir.is_generator:
            at_once(self, emit_dels, extend_lifetimes)
            return
        ir.blocks = canonicalize_cfg(ir.blocks)
        ir.variable_lifetime = VariableLifetime(ir.blocks)
        ir.generator_info = None

    PostProcessor.run = run


class _Remembered:
    """Signatures of built-in functions, by the types of their arguments and the options of the kernel.

    numba tries every implementation that there is of an operator, some thirty, each time that one is used.

    Parameters
    ----------
    resolve
        What numba calls: a method of a built-in function's type.
    """

    def __init__(self, resolve: Any) -> None:
        self._resolve = resolve
        self._known: dict[Any, tuple[Any, Any, Any, Any]] = {}
        self._options: dict[Any, int] = {}
        self._flags: Any = None
        self._number = -1

    def ask(self) -> Any:
        """Return the method that stands in for `resolve`."""

        def get_call_type(function: Any, context: Any, arguments: Any, keywords: Any) -> Any:
            if keywords or not isinstance(arguments, tuple):  # a list, as numba's stencils have it, is no key
                return self._resolve(function, context, arguments, keywords)
            key = id(function), id(context), arguments, self._options_now()
            known = self._known.get(key)
            if known is None:
                signature = self._resolve(function, context, arguments, keywords)
                if signature is not None:
                    implementation = function._impl_keys[signature.args]  # noqa: SLF001
                    self._known[key] = function, context, signature, implementation
                return signature
            _, _, signature, implementation = known  # the first two are kept, and so their ids are theirs
            function._impl_keys[signature.args] = implementation  # noqa: SLF001 - as of the last that asked
            return signature

        return get_call_type

    def _options_now(self) -> int:
        """Return a number for the options of the kernel that is being compiled."""
        flags = ConfigStack.top_or_none()
        if flags is not self._flags:
            options = None if flags is None else str(sorted(flags.values().items()))
            self._flags, self._number = flags, self._options.setdefault(options, len(self._options))
        return self._number
