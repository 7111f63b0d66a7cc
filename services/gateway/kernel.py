"""The one way in which a function of the gateway becomes machine code: cached, typed for whoever calls it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def kernel(function: Function) -> Function:
    """Return `function` compiled at its first call, kept on disk after that; no allocation, no Python inside."""
    return cast(Function, numba.njit(cache=True, nogil=True, fastmath=False)(function))
