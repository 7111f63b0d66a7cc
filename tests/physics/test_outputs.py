"""What physics says that nobody waits for costs no tick."""

from __future__ import annotations

import pytest

from tests.memory_bus import MemoryBus
from tests.physics.conftest import Rig
from trocar.services.mechanics.simulation import Simulation

FAR = (0.02, -0.05, 0.08)


def test_the_inserted_length_is_measured_between_two_ticks_and_sixty_times_a_second(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[int] = []

    def measure(_simulation: Simulation) -> float:
        measured.append(rig.tick)
        return 0.01 * len(measured)

    monkeypatch.setattr(Simulation, "inserted_length_m", property(measure))
    observer = MemoryBus(rig.hub, reads=["physics.state"])
    told = []
    for _ in range(48):
        before = len(measured)
        rig.turn(FAR, FAR)
        assert len(measured) == before
        rig.physics.do_side_work()
        frame = observer.latest("physics.state")
        assert frame is not None
        told.append(frame.body.catheter.inserted_length_m)
    assert len(measured) == 3
    assert sorted(set(told)) == pytest.approx([0.0, 0.01, 0.02, 0.03])


def test_while_the_rigs_time_stands_its_tick_has_one_state(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a recording would keep one that running it again does not give."""
    monkeypatch.setattr(Simulation, "inserted_length_m", 0.01)
    observer, told = MemoryBus(rig.hub, reads=["physics.state"]), []
    for tick in (0, 0, 0, 1):
        rig.tick = tick
        rig.turn(FAR, FAR)
        rig.physics.do_side_work()
        frame = observer.latest("physics.state")
        assert frame is not None
        told.append(frame.body)
    assert told[0] == told[1] == told[2]
    assert [each.catheter.inserted_length_m for each in told] == [0.0, 0.0, 0.0, 0.01]


def test_between_the_same_two_ticks_it_measures_looks_for_orders_or_reports(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two of them together ran into the next tick where the host was slow."""
    done: list[tuple[int, str]] = []
    monkeypatch.setattr(Simulation, "inserted_length_m", property(lambda _: done.append((rig.tick, "measured")) or 0.0))
    health = rig.physics_process.health
    monkeypatch.setattr(health, "do_a_piece", lambda: done.append((rig.tick, "reported")), raising=False)
    drain = rig.physics_process.bus.drain
    monkeypatch.setattr(
        rig.physics_process.bus, "drain", lambda topic: done.append((rig.tick, f"looked at {topic}")) or drain(topic)
    )
    for _ in range(40):
        rig.turn(FAR, FAR)
        before = len(done)
        rig.physics.do_side_work()
        assert len(done) == before + 1
    ticks = [tick for tick, _ in done]
    assert len(set(ticks)) == len(ticks) == 40
    assert {what for _, what in done} == {"measured", "looked at supervisor.state", "reported"}
