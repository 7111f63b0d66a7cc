"""Twelve benches write into one database at once, new or there already: nothing is lost, whoever comes and goes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.by_day import by_day
from tests.review.benches import keep_at_once
from trocar.review.attempts.store.attempts import Store

BENCHES, ATTEMPTS = 12, 20
pytestmark = pytest.mark.timeout(600)


@pytest.mark.parametrize("seed", by_day([1], range(2, 11)))
@pytest.mark.parametrize("is_new", [True, False])
def test_no_attempt_is_lost_in_sqlite(tmp_path: Path, seed: int, is_new: bool) -> None:
    url = str(tmp_path / "a.sqlite")
    if not is_new:
        with Store(url):
            pass
    assert keep_at_once(url, BENCHES, ATTEMPTS, seed) == (0, [])


@pytest.mark.parametrize("seed", by_day([1], range(2, 11)))
def test_no_attempt_is_lost_in_postgresql(new_postgres: Callable[[], str], seed: int) -> None:
    assert keep_at_once(new_postgres(), BENCHES, ATTEMPTS, seed) == (0, [])
