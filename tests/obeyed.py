"""Orders to a rig, given again where a busy machine let one come too late: of such a one nothing was done."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from tests.patience import PATIENCE_S
from trocar.services.runtime.errors import UserError

T = TypeVar("T")


def until_obeyed(order: Callable[[], T]) -> T:
    """Give an order until the rig obeys; return what `order` does. Raises what it raises where it never does."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return order()
        except UserError:
            if time.monotonic() > end_s:
                raise
