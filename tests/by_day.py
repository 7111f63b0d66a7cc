"""Cases of one test of which a few run by day and the others with ``--long``, before a release.

The few are chosen, or drawn anew in every run.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import settings

#: The profile of hypothesis with ``--long``.
LONG = "trocar-long"


def by_day(chosen: Iterable[Any], others: Iterable[Any]) -> list[Any]:
    """Return the cases of a parametrized test, each its argument or a tuple of them; `others` are marked ``long``."""
    left = [pytest.param(*(each if isinstance(each, tuple) else (each,)), marks=pytest.mark.long) for each in others]
    return [*chosen, *left]


def examples(by_day: int, with_long: int) -> int:
    """Return how many examples of a property a run draws."""
    return with_long if settings.get_current_profile_name() == LONG else by_day
