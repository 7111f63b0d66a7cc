"""The table as a CSV file."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path

from trocar.services.files.atomic_file import atomic_file
from trocar.studies.accuracy.frontier import frontier
from trocar.studies.accuracy.study import Row

COLUMNS = (
    "study",
    "setting",
    "series",
    "quantity",
    "error",
    "unit",
    "cost_median_us",
    "cost_p99_us",
    "cost_noise_us",
    "on_frontier",
    "choices",
)


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write all rows; an error is told to the last digit."""
    best = frontier_rows(rows)
    with atomic_file(path) as half, half.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for row in rows:
            cost = [row.cost.median_us, row.cost.p99_us, row.cost.noise_us] if row.cost else ["", "", ""]
            told = [f"{each:.2f}" if isinstance(each, float) else each for each in cost]
            head = [row.study, row.setting, row.series, row.quantity, repr(row.error), row.unit]
            writer.writerow([*head, *told, int(id(row) in best), json.dumps(dict(row.choices))])


def frontier_rows(rows: Sequence[Row]) -> set[int]:
    """Return the identities of the rows that are on the frontier of their study and quantity."""
    places = dict.fromkeys((row.study, row.quantity) for row in rows)
    return {
        id(best) for place in places for best in frontier([row for row in rows if (row.study, row.quantity) == place])
    }
