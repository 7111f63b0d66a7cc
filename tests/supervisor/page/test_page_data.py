"""What the page's process knows is what it reads on the bus, where no peer can end it."""

from __future__ import annotations

import msgspec
import pytest

import trocar.protocol.bodies as bodies
from tests.memory_bus import MemoryBus, MemoryHub
from tests.protocol.garbled import SEEDS
from tests.supervisor.made_up import Bench, health, rig
from trocar.protocol.bodies.supervisor import EVENTS_TOLD, LINE_CHARS
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page import page_server
from trocar.services.supervisor.page.page_server import ATTEMPT, SILENT_S, PageData
from trocar.services.supervisor.page.rig_listener import JUDGEMENT, STATE, TOPICS


@pytest.fixture
def bench() -> Bench:
    return Bench(rig(contracts={"loops": {"physics": {"rate_hz": 1000, "miss_ratio": 0.01}}}))


@pytest.fixture
def page(bench: Bench) -> PageData:
    return PageData(bench.rig)


def listening(hub: MemoryHub) -> MemoryBus:
    return MemoryBus(hub, reads=[ATTEMPT, *TOPICS])


def test_it_shows_the_rig_from_its_first_moments_on(bench: Bench, page: PageData) -> None:
    bus = listening(bench.hub)
    page.hear_rig(bus)
    assert page.snapshot("default") is None
    assert page.healthy() == (False, "the supervisor has said nothing yet")
    bench.peers["physics"].state = "starting"
    bench.run(0.1)
    page.hear_rig(bus)
    shown = page.snapshot("default")
    assert shown is not None
    assert (shown.state, shown.incarnation) == ("starting", bench.supervisor.incarnation)
    bench.peers["physics"].state = "ready"
    bench.run(9.0, lambda: bench.supervisor.state is RigState.RUNNING)
    bench.supervisor.say("warning", "something happened")
    bench.run(0.3)
    page.hear_rig(bus)
    shown = page.snapshot("default")
    assert shown is not None
    assert (shown.state, page.healthy()) == ("running", (True, "running"))
    assert shown.events[-1] == {"t": bench.supervisor.events[-1].t, "level": "warning", "text": "something happened"}
    assert 0.0 <= bench.now_s - bench.supervisor.started_s - shown.t < 0.21, "its time is the rig's, as commands need"
    assert {row.name for row in shown.processes if row.loop} == set(bench.peers), "their own reports are heard"


def test_degraded_is_shown_with_its_reason_and_the_contract(bench: Bench, page: PageData) -> None:
    bus = listening(bench.hub)
    bench.run(9.0, lambda: bench.supervisor.state is RigState.RUNNING)
    bench.peers["physics"].miss_ratio = 0.9
    bench.run(9.0, lambda: bench.supervisor.state is RigState.DEGRADED)
    for _ in range(2):  # the counts of a loop are those between two reports
        bench.run(0.3)
        page.hear_rig(bus)
    shown = page.snapshot("default")
    assert shown is not None
    assert shown.state == "degraded"
    assert shown.reason.startswith("physics:")
    assert page.healthy() == (True, f"degraded: {shown.reason}")
    kept = {row.name: row.loop.contract_ok for row in shown.processes if row.loop is not None}
    assert [name for name, is_kept in kept.items() if not is_kept] == ["physics"]


def test_a_silent_supervisor_is_told(bench: Bench, page: PageData, monkeypatch: pytest.MonkeyPatch) -> None:
    bus = listening(bench.hub)
    bench.run(9.0, lambda: bench.supervisor.state is RigState.RUNNING)
    page.hear_rig(bus)
    assert page.healthy()[0]
    assert page.source().is_judged
    heard_s = page.listener.judged_s
    monkeypatch.setattr(page_server.time, "monotonic", lambda: heard_s + SILENT_S + 1.0)
    page.hear_rig(bus)
    assert page.healthy() == (False, f"the supervisor has said nothing for {SILENT_S + 1.0:.1f} s")
    assert not page.source().is_judged


def test_what_is_no_judgement_is_refused_by_name_and_changes_nothing(bench: Bench, page: PageData) -> None:
    bus = listening(bench.hub)
    bench.run(0.3)
    page.hear_rig(bus)
    before = msgspec.json.encode(page.snapshot("default"))
    good = SEEDS[JUDGEMENT]
    for bad in (b"", b"\xc1", good[:-1], good[: len(good) // 2], SEEDS[STATE], msgspec.msgpack.encode([1, JUDGEMENT])):
        for name in (JUDGEMENT, STATE):
            if bad is SEEDS[name]:
                continue
            bench.hub.send(name, bad)
            page.hear_rig(bus)
    assert msgspec.json.encode(page.snapshot("default")) == before
    refused = {report.topic: sum(report.refused.values()) for report in bus.reports()}
    assert (refused[JUDGEMENT], refused[STATE]) == (6, 5)


def test_a_peer_that_makes_things_up_ends_nothing(page: PageData) -> None:
    """A true frame of somebody else's: processes that there are not, numbers that are none."""
    hub = MemoryHub()
    bus, stranger = listening(hub), MemoryBus(hub, publishes=[STATE, JUDGEMENT, "gateway.health"])
    nobody = bodies.ProcessReport(name="nobody", state="?", pid=1 << 62)
    stranger.publish(STATE, bodies.SupervisorState(state="?", processes=(nobody,)))
    event = bodies.Event(float("nan"), "?", "x" * LINE_CHARS)
    stranger.publish(
        JUDGEMENT,
        bodies.Judgement(
            incarnation=0, t=float("inf"), broken=("?",), path_limits_us={"?": float("nan")},
            events=(event,) * EVENTS_TOLD, starts=(bodies.StartReport(process="?", stage="?", fraction=7.0),),
        ),
    )  # fmt: skip
    stranger.publish("gateway.health", health("nobody"))
    page.hear_rig(bus)
    assert page.snapshot("default") is not None
    msgspec.json.encode(page.snapshot("default"))
    assert page.healthy() == (False, "?")
    assert not page.source().heard.keys() - {"gateway"}


def test_what_the_supervisor_publishes_is_always_read(bench: Bench) -> None:
    """Texts longer than a body may hold, and more events than are told, as of a log that a process floods."""
    ears = MemoryBus(bench.hub, reads=[JUDGEMENT])
    bench.supervisor.start_notice = "n" * 9999
    for _ in range(3 * EVENTS_TOLD):
        bench.supervisor.say("warning", "x" * 9999)
    bench.run(0.1)
    frame = ears.latest(JUDGEMENT)
    assert frame is not None
    assert len(frame.body.events) == EVENTS_TOLD


@pytest.mark.parametrize("uptime_s", [float("nan"), float("inf")])
def test_reports_of_no_time_are_not_kept_for_ever(page: PageData, uptime_s: float) -> None:
    """Neither here nor in the supervisor, which judges by the same windows."""
    hub = MemoryHub()
    bus, stranger = listening(hub), MemoryBus(hub, publishes=["gateway.health"])
    for _ in range(50):
        stranger.publish("gateway.health", health("gateway", uptime_s=uptime_s))
        page.hear_rig(bus)
    heard = page.listener.heard["gateway"]
    assert heard.health is not None
    assert (len(heard.window), len(heard._maxima)) == (0, 1)
