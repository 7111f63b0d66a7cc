"""What a flight ring tells of a loop that nobody listens to."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from trocar.services.runtime.measures.flight import SUFFIX, FlightRing
from trocar.services.supervisor.crew.loop_progress import LoopProgress


@pytest.fixture
def progress(tmp_path: Path) -> Iterator[LoopProgress]:
    tmp_path.chmod(0o700)
    with closing(LoopProgress(tmp_path)) as made:
        yield made


def ring(folder: Path) -> FlightRing:
    made = FlightRing(1000.0)
    made.share(folder / f"physics{SUFFIX}")
    return made


def tick(made: FlightRing, count: int = 1) -> None:
    for index in range(count):
        made.write(index, 0, 0, 0, 0, ())


def test_a_loop_ticks_while_its_ring_grows(progress: LoopProgress, tmp_path: Path) -> None:
    made = ring(tmp_path)
    tick(made)
    assert progress.ticked("physics", os.getpid()) is False, "when it ticked is not known yet"
    for _ in range(3):
        tick(made, made.capacity)
        assert progress.ticked("physics", os.getpid()) is True
        assert progress.ticked("physics", os.getpid()) is False


def test_without_a_ring_of_that_process_nothing_is_known(progress: LoopProgress, tmp_path: Path) -> None:
    assert progress.ticked("physics", os.getpid()) is None
    ring(tmp_path)
    (tmp_path / f"haptics{SUFFIX}").write_bytes(b"TROCARF1 and nonsense")
    assert progress.ticked("physics", os.getpid() + 1) is None
    assert progress.ticked("haptics", os.getpid()) is None
    assert LoopProgress(None).ticked("physics", os.getpid()) is None


def test_a_new_process_with_the_same_number_has_a_ring_of_its_own(progress: LoopProgress, tmp_path: Path) -> None:
    """In a container every incarnation is process 1."""
    tick(ring(tmp_path))
    progress.ticked("physics", os.getpid())
    second = ring(tmp_path)
    assert progress.ticked("physics", os.getpid()) is False
    progress.ticked("physics", os.getpid())
    tick(second)
    assert progress.ticked("physics", os.getpid()) is True
