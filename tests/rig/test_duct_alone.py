"""A scene that names but a duct, running: neither gateway nor haptics, no socket of theirs, and a wall that is told."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from tests.rig.conftest import Rig, running_rig
from trocar.protocol.bodies import PhysicsState
from trocar.services.runtime.measures.flight import flight_directory

pytestmark = pytest.mark.timeout(600)

SMALL = ["duct.n_around=12", "duct.n_along=14", "duct.n_modes=20"]
OF_CONTACT = ("gateway", "haptics")


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with running_rig(tmp_path, "duct-only", SMALL, ("physics.state",)) as rig:
        yield rig


def test_runs_what_a_duct_calls_for_and_nothing_else(rig: Rig) -> None:
    states: list[PhysicsState] = []

    def has_come() -> bool:
        states.extend(frame.body for frame in rig.observer.bus.drain("physics.state"))
        return len(states) > 100

    rig.observer.until(has_come, 120.0, "a hundred states of the wall")
    assert set(rig.observer.pids()) == {"physics", "visualization", "recorder"}
    bus = rig.directory / "bus"
    names = [path.name for path in bus.iterdir()]
    assert any(name.startswith("physics.state") for name in names)
    assert not [name for name in names if name.startswith((*OF_CONTACT, "visualization.hands"))]
    assert sorted(path.stem for path in flight_directory(bus).iterdir() if path.stem in (*OF_CONTACT, "physics")) == [
        "physics"
    ]
    last = states[-1]
    assert last.reactions() == ()
    assert last.catheter.position_m.view().shape == (0, 3)
    assert last.contacts.kind.view().size == 0
    assert last.duct.q.view().size == 20
    assert all(b.tick > a.tick for a, b in pairwise(states))
