"""The table of values with their ranges and sources, of `trocar tissues`, `catheters` and `cystic-duct`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from rich.markup import escape
from rich.table import Table


class ValueRow(NamedTuple):
    """A named value in SI units, its range, and its source as people read it."""

    name: str
    value: float
    low: float
    high: float
    source: str


def value_table(title: str, rows: Iterable[ValueRow], of_values: str = "is") -> Table:
    """Return a table whose first column has a title, and that of the values another."""
    table = Table(box=None, pad_edge=False)
    for column in (title, of_values, "from", "to", "source"):
        table.add_column(column, overflow="fold", no_wrap=column == title)
    for row in rows:
        numbers = (f"{number:g}" for number in (row.value, row.low, row.high))
        table.add_row(escape(row.name), *numbers, escape(row.source))
    return table
