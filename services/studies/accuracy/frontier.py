"""The Pareto frontier: settings that no other one beats in both error and cost."""

from __future__ import annotations

import math
from collections.abc import Sequence

from services.studies.accuracy.study import Row


def frontier(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of one quantity that no other beats in error and cost, from the cheapest on.

    Rows without a cost, without a finite error, or whose differences are not errors have no place there.
    """
    judged = [row for row in rows if row.cost is not None and row.is_known and math.isfinite(row.error)]
    judged.sort(key=lambda row: (row.cost.median_us if row.cost else 0.0, row.error))
    best: list[Row] = []
    for row in judged:
        if not best or row.error < best[-1].error:
            best.append(row)
    return best
