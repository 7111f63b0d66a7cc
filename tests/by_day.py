"""Cases of one test of which a few, chosen, run by day and the others with ``--long``: before a release."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def by_day(chosen: Iterable[Any], others: Iterable[Any]) -> list[Any]:
    """Return the cases of a parametrized test, each its argument or a tuple of them; `others` are marked ``long``."""
    left = [pytest.param(*(each if isinstance(each, tuple) else (each,)), marks=pytest.mark.long) for each in others]
    return [*chosen, *left]
