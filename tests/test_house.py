"""The house can be taken over: it is counted by package, and nothing of it hangs on another library's inside."""

from __future__ import annotations

import pytest

from benchmarks.house import House, count, table


@pytest.fixture(scope="module")
def house() -> House:
    return count()


def test_nothing_private_of_numba_is_used(house: House) -> None:
    assert house.private_numba == 0


def test_the_table_has_a_row_for_every_package(house: House) -> None:
    rows = list(table(house))
    assert any(row.startswith("| services/gateway |") for row in rows)
    assert len({row.split("|")[1] for row in rows[2:-2]}) == len(rows) - 4
