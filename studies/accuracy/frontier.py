"""The Pareto frontier: settings that no other one beats in both error and cost, as far as costs can be told apart."""

from __future__ import annotations

import math
from collections.abc import Sequence

from trocar.studies.accuracy.study import Cost, Row

ROUNDING = 1e-4
"""Errors below, in the unit of their quantity, are rounding: none of them is better than another."""


def frontier(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of one quantity that no other beats in error and cost, from the cheapest on.

    One is cheaper than another only if its median is lower by more than the noise of both. So whoever is less wrong
    and not dearer beyond noise beats the other, and of those on the frontier each costs more, beyond noise, than all
    that are more wrong. Rows without a cost, without a finite error, or whose differences are not errors have no place
    there.
    """
    judged = [row for row in rows if row.cost is not None and row.is_known and math.isfinite(row.error)]
    best = [row for row in judged if not any(_beats(other, row) for other in judged)]
    return sorted(best, key=lambda row: (row.cost.median_us if row.cost else 0.0, row.error))


def _beats(one: Row, other: Row) -> bool:
    if one.cost is None or other.cost is None:
        return False
    mine, its = max(one.error, ROUNDING), max(other.error, ROUNDING)
    if mine == its:
        return _is_cheaper(one.cost, other.cost)
    return mine < its and not _is_cheaper(other.cost, one.cost)


def _is_cheaper(one: Cost, other: Cost) -> bool:
    return one.median_us + one.noise_us < other.median_us - other.noise_us
