"""A PostgreSQL for all tests of the store, and an attempt to keep in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.review import postgres
from tests.review.test_assess import terms, told
from tests.training.streams import changed, messages
from trocar.review.attempts.assess import assess
from trocar.review.attempts.assessment import Assessment


@pytest.fixture(scope="session")
def new_postgres() -> Iterator[Callable[[], str]]:
    """Make a database and return its address."""
    if postgres.programs() is None:
        pytest.skip("no PostgreSQL on this machine (Debian's package postgresql)")
    with postgres.short_folder() as folder, postgres.server(folder) as make:
        yield make


@pytest.fixture(scope="module")
def attempt() -> Assessment:
    deep = changed({"inserted": [(0.5, 0.0), (1.5, 15e-3)], "hold": [(0.1, 0.0), (0.101, 1.0)]})
    (found,) = assess(told(messages(deep, 2.0), 2.0), terms(), "a.mcap")
    return found
