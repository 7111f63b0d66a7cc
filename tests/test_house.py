"""The house stays small enough to be taken over: limits of size, and nothing that hangs on another library's inside."""

from __future__ import annotations

import pytest

from benchmarks.house import House, count, table

#: What a rig runs, with attempts, replay, score, metrics of the task, the classroom and clocks of several hosts.
MOST_LINES = 62_000
MOST_WORDS = 45_000


@pytest.fixture(scope="module")
def house() -> House:
    return count()


def test_what_a_rig_runs_has_at_most_its_lines(house: House) -> None:
    _, lines, _ = house.of("services")
    assert 10_000 < lines <= MOST_LINES


def test_documents_are_at_most_a_book_that_one_reads(house: House) -> None:
    assert 10_000 < house.words <= MOST_WORDS


def test_nothing_private_of_numba_is_used(house: House) -> None:
    assert house.private_numba == 0


def test_the_table_has_a_row_for_every_package(house: House) -> None:
    rows = list(table(house))
    assert any(row.startswith("| services/gateway |") for row in rows)
    assert len({row.split("|")[1] for row in rows[2:-2]}) == len(rows) - 4
