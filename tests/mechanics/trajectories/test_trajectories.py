"""The mechanics does what it did when the figures beside this file were recorded, and every time the same bits."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from tests.by_day import by_day

from . import figures
from .broken import BREAKS
from .cases import CASES
from .observe import Run, first_difference, run

pytestmark = pytest.mark.timeout(600)

#: Largest text of a case.
MOST_BYTES = 8_000
#: Where each break shows, and that by day; with ``--long`` also in the others in which it must.
BY_DAY = [("insertion", "softer_catheter"), *(("anatomy", each) for each in ("softer_wall", "less_damping"))]
BY_DAY += [("anatomy", "more_friction")]
WITH_LONG = [("insertion", each) for each in ("softer_wall", "less_damping", "no_damping", "more_friction")]
WITH_LONG += [("anatomy", "no_damping"), ("pinch", "no_damping"), ("pinch", "more_friction")]


@pytest.fixture(scope="module")
def apart() -> Iterator[ProcessPoolExecutor]:
    """Return two processes that run nothing else, as the one that has recorded the figures.

    A kernel that another test has compiled for strided arrays would serve here too, and sum in another order.
    """
    with ProcessPoolExecutor(2, get_context("spawn"), max_tasks_per_child=1) as pool:
        yield pool


@pytest.fixture(scope="module", params=CASES)
def today(request: pytest.FixtureRequest, own_cache: Path, apart: ProcessPoolExecutor) -> tuple[str, Run]:
    """A case as it runs today."""
    return request.param, _result(apart, request.param, own_cache / "bases")


def _result(apart: ProcessPoolExecutor, name: str, *others: object) -> Run:
    try:
        return apart.submit(_run, name, *others).result()
    except FileNotFoundError as missing:
        pytest.skip(f"needs the scan {missing}")


def _run(name: str, cache_dir: Path, broken: str = "", seed: int | None = None, start: float = 0.0) -> Run:
    case = CASES[name](cache_dir)
    jiggle = None if seed is None else np.random.default_rng(seed)
    return run(BREAKS[broken](case) if broken else case, jiggle=jiggle, start=start)


def _beyond(name: str, found: Run) -> dict[str, float]:
    """Return the quantities that depart from what was recorded by more than their tolerances, and by how many."""
    departures = figures.departures(figures.summary(found), figures.read(name))
    return {key: round(share, 2) for key, share in departures.items() if share > 1.0}


def test_it_does_what_was_recorded(today: tuple[str, Run]) -> None:
    """If that was meant to change: `python -m tests.mechanics.trajectories record`."""
    name, found = today
    assert _beyond(name, found) == {}


def test_another_process_gives_the_same_bits(
    today: tuple[str, Run], own_cache: Path, apart: ProcessPoolExecutor
) -> None:
    name, found = today
    assert first_difference(found, _result(apart, name, own_cache / "bases")) is None


def _twice(name: str, cache_dir: Path) -> tuple[Run, Run, Run]:
    case = CASES[name](cache_dir)
    return run(case), run(case), run(CASES[name](cache_dir), start=1e-15)


def test_one_process_gives_the_same_bits_again_and_other_bits_are_noticed(
    own_cache: Path, apart: ProcessPoolExecutor
) -> None:
    first, again, elsewhere = apart.submit(_twice, "pinch", own_cache / "bases").result()
    assert first_difference(first, again) is None
    assert first_difference(first, elsewhere) == 0


@pytest.mark.parametrize(("name", "broken"), by_day(BY_DAY, WITH_LONG))
def test_a_break_is_noticed(name: str, broken: str, own_cache: Path, apart: ProcessPoolExecutor) -> None:
    assert _beyond(name, _result(apart, name, own_cache / "bases", broken))


@pytest.mark.parametrize("name", by_day(["anatomy"], ["insertion", "pinch"]))
def test_rounding_is_not_noticed(name: str, own_cache: Path, apart: ProcessPoolExecutor) -> None:
    """With other seeds than those by which the tolerances were measured."""
    for how in ({"seed": 101}, {"start": 1e-12}):
        try:
            found = apart.submit(_run, name, own_cache / "bases", **how).result()  # type: ignore[arg-type]
        except FileNotFoundError as missing:
            pytest.skip(f"needs the scan {missing}")
        assert _beyond(name, found) == {}, how


@pytest.mark.parametrize("name", CASES)
def test_the_recorded_runs_go_through_what_they_are_for(name: str) -> None:
    """A run in which nothing touches would prove nothing."""
    lines = figures.read(name)
    assert figures.path_of(name).stat().st_size < MOST_BYTES
    assert lines["contacts"].values.mean() > 0.3
    assert min(lines["tool0_n.most"].values, lines["tool1_n.most"].values) > 5e-3, "both tools feel the scene"
    if name == "insertion":
        assert lines["inserted_m.most"].values > 20e-3
        assert np.ptp(lines["stone_x_m"].values) > 0.5e-3
    if name == "pinch":
        assert min(lines["jaw0_nm.most"].values, lines["jaw1_nm.most"].values) > 4e-3, "what the wall pushes"


@pytest.mark.parametrize("name", CASES)
def test_a_file_is_what_its_figures_write(name: str) -> None:
    assert figures.text(name, figures.read(name)) == figures.path_of(name).read_text()
