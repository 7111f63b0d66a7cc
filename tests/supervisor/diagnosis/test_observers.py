"""What is seen beside the rig: the machine's floor, threads as the kernel counts them, flights of missed ticks."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import prometheus_client
import pytest

import trocar.protocol.bodies as bodies
from tests.real_time import fifo_is_granted
from tests.supervisor.made_up import MS, health, histogram, loop_report
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.measures.flight import FlightRing
from trocar.services.runtime.measures.flights import Flight, read_file, read_ring
from trocar.services.runtime.measures.stage_times import StageTimes
from trocar.services.supervisor.diagnosis import incident_files
from trocar.services.supervisor.diagnosis.core_sleepers import PHASES, Phases
from trocar.services.supervisor.diagnosis.incident_files import IncidentFiles
from trocar.services.supervisor.diagnosis.lateness_floor import CoreLateness, has_deadline_loops
from trocar.services.supervisor.diagnosis.machine_floor import MachineFloor, below_sleepers
from trocar.services.supervisor.diagnosis.observer import RigSight, Row
from trocar.services.supervisor.diagnosis.thread_usage import Counts, ThreadUsage
from trocar.services.supervisor.diagnosis.wakeup_phase import idle_phase_ns
from trocar.services.supervisor.judge.figures import Latencies
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.dashboard import Heard
from trocar.services.supervisor.page.metrics import RigSource, registry
from trocar.services.supervisor.page.observer_registry import Report

#: The kernel adds up what a thread has run, and what it has waited, when it is switched, or as its timer ticks.
TICK_NS = 10 * MS


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    tmp_path.chmod(0o700)
    return tmp_path


def eventually(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it did not happen"
        time.sleep(0.02)


def _floor(directory: Path, parent: str = "") -> subprocess.Popen[bytes]:
    code = f"import subprocess, sys; {parent}" if parent else ""
    command = [sys.executable, "-m", "trocar.services.supervisor.diagnosis.core_sleepers", str(directory)]
    if not code:
        return subprocess.Popen(command)
    return subprocess.Popen(
        [sys.executable, "-c", f"{code}; subprocess.Popen({command!r}); sys.stdin.read()"], stdin=subprocess.PIPE
    )


def _ticks(path: Path) -> int:
    flight = read_ring(path)
    return 0 if flight is None else int(flight.column("tick").max(initial=0))


def _newest_due_ns(path: Path) -> int:
    flight = read_ring(path)
    return 0 if flight is None else int(flight.column("due_ns").max(initial=0))


def _ring(name: str, core: int, begins_ns: int, ends_ns: int) -> Flight:
    """A loop of 1 kHz that works from `begins_ns` to `ends_ns` of each period, from an odd moment of the clock on."""
    tick = np.arange(500)
    due = 123_456_000_000 + tick * MS + begins_ns
    rows = np.stack([tick, due, due + 10_000, due + ends_ns - begins_ns, np.zeros_like(tick)], axis=1)
    return Flight(name, 7, 1000.0, (core,), (), rows)


def test_the_quiet_moment_is_where_no_loop_of_that_core_works_or_is_about_to() -> None:
    rig = (_ring("gateway", 0, 0, 90_000), _ring("haptics", 0, 90_000, 450_000), _ring("physics", 1, 400_000, 950_000))
    phase = {core: idle_phase_ns(rig, core) for core in (0, 1)}
    assert 450_000 <= (phase[0] or 0) <= 580_000
    assert 950_000 <= (phase[1] or 0) <= 980_000
    over = (_ring("physics", 1, 400_000, 1_400_000),)  # busy all the time: any moment is as good
    assert idle_phase_ns(over, 1) is not None
    assert idle_phase_ns(rig, 2) is None
    slow = Flight("picture", 7, 36.0, (1,), (), rig[0].rows)
    everywhere = Flight("physics", 7, 1000.0, (0, 1), (), rig[0].rows)
    assert idle_phase_ns((slow, everywhere), 1) is None


def test_the_floor_watches_every_core_and_ends_with_who_started_it(directory: Path) -> None:
    phases = Phases(directory / PHASES, create=True)
    starter = _floor(directory, parent="pass")
    cores = sorted(os.sched_getaffinity(0))
    rings = [directory / f"floor{core}.flight" for core in cores]
    eventually(lambda: all(_ticks(ring) > 20 for ring in rings))
    flight = read_ring(rings[0])
    assert flight is not None
    assert flight.cores == (cores[0],)
    assert (flight.column("began_ns") >= flight.column("due_ns")).all()  # nobody wakes before the time
    phases[cores[0]] = 620_000  # told where in a millisecond to wake, it does so from then on
    eventually(lambda: (_newest_due_ns(rings[0]) - 620_000) % MS == 0)
    assert starter.stdin is not None
    starter.stdin.close()
    starter.wait()
    eventually(lambda: not Path(f"/proc/{flight.pid}").exists() or "Z" in _state(flight.pid))


def _state(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return "Z"


def test_late_wake_ups_are_counted_once_and_shares_are_of_a_minute(directory: Path) -> None:
    ring = FlightRing(100.0)
    path = directory / "floor0.flight"
    ring.share(path)
    core = CoreLateness()
    for second in range(100):
        for k in range(100):
            due = (second * 100 + k) * 10 * MS
            late = 3 * MS if second == 20 and k < 7 else 50_000
            ring.write(k, due, due + late, due + late, 0, ())
            if k % 20 == 19:  # more often than the ring is full
                core.take(path, second + k / 100)
        if second == 70:
            recent = core.row().lately
            assert (recent.late, recent.total) == (7, pytest.approx(6000, abs=40))
    assert (core.counts.total, Latencies.of(core.counts.body()).late) == (10_000, 7)
    assert core.row().lately.late == 0
    assert core.counts.max_ns == 3 * MS


def test_a_long_stall_counts_as_all_wake_ups_that_it_replaced(directory: Path) -> None:
    """A stall of 50 ms in a second costs a loop 5 % of its ticks, and the sleeper 5 of its 100 wake-ups."""
    ring = FlightRing(100.0)
    path = directory / "floor0.flight"
    ring.share(path)
    core = CoreLateness()
    for k in (k for k in range(100) if not 20 < k < 25):
        ring.write(k, due := (k + 1) * 10 * MS, due + (45 * MS if k == 20 else 0), 0, 0, ())
    core.take(path, 1.0)
    assert (core.counts.total, Latencies.of(core.counts.body()).late) == (100, 5)


def test_threads_are_counted_as_the_kernel_does() -> None:
    """A child that sleeps again and again is woken so often, and is runnable for less time than one that spins.

    What is told of the time between two looks lies between what the kernel says of the longest and of the shortest time
    that may be meant: how much of the machine either has had is not the test's to say.
    """
    sleeper = subprocess.Popen([sys.executable, "-c", "import time\nwhile True: time.sleep(0.005)"])
    spinner = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        eventually(lambda: _woken(sleeper.pid) > 100 and _busy_ns(spinner.pid) > 200 * MS)
        watch = ThreadUsage()
        pids = {"sleeper": sleeper.pid, "spinner": spinner.pid, "gone": 2**22 - 1, "not started": 0}
        outer = _woken(sleeper.pid), _busy_ns(spinner.pid)
        watch.sample(RigSight(10.0, pids))
        inner = _woken(sleeper.pid), _busy_ns(spinner.pid)
        watch.sample(RigSight(10.5, pids))  # too early: not looked at
        assert not any(row.lately for row in watch.report().values())
        eventually(lambda: _woken(sleeper.pid) > inner[0] + 100 and _busy_ns(spinner.pid) > inner[1] + 200 * MS)
        least = _woken(sleeper.pid) - inner[0], _busy_ns(spinner.pid) - inner[1]
        watch.sample(RigSight(11.5, pids))
        most = _woken(sleeper.pid) - outer[0], _busy_ns(spinner.pid) - outer[1]
        usage = {name: row.lately for name, row in watch.report().items()}
        assert usage.keys() == {"sleeper", "spinner"}
        spins, sleeps = usage["spinner"], usage["sleeper"]
        assert spins.seconds == 1.5
        assert least[0] <= round(sleeps.wakeups_per_s * 1.5) <= most[0]
        told_ns = round((spins.processor_share + spins.waited_share) * 1.5e9)
        assert least[1] - TICK_NS <= told_ns <= most[1] + TICK_NS
        assert spins.wakeups_per_s < 0.2 * sleeps.wakeups_per_s
        assert sleeps.processor_share + sleeps.waited_share < spins.processor_share + spins.waited_share
        busiest = watch.busiest()
        assert {row.process for row in busiest} == {"sleeper", "spinner"}
        assert busiest[0].ran_s == max(row.ran_s for row in busiest)
        assert watch.report()["spinner"].since_start.ran_ns > 0
    finally:
        for process in (sleeper, spinner):
            process.kill()
            process.wait()


def _woken(pid: int) -> int:
    """Return how often a process has given its processor up."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("voluntary_ctxt_switches"))


def _busy_ns(pid: int) -> int:
    """Return for how long a process has run and waited to."""
    return sum(map(int, Path(f"/proc/{pid}/schedstat").read_text().split()[:2]))


def test_what_a_process_started_is_its_own_unless_it_has_a_name() -> None:
    child = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(30)'])"
    parent = subprocess.Popen([sys.executable, "-c", child])
    try:
        eventually(lambda: _children(parent.pid) != [])
        (grandchild,) = _children(parent.pid)
        alone, named = ThreadUsage(), ThreadUsage()
        alone.sample(RigSight(0.0, {"parent": parent.pid}))
        named.sample(RigSight(0.0, {"child": grandchild, "parent": parent.pid}))
        assert alone.report().keys() == {"parent"}
        assert named.report().keys() == {"parent", "child"}
        os.kill(grandchild, 9)
    finally:
        parent.kill()
        parent.wait()


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _missed(misses: int, rate_hz: float = 1000.0, pid: int = 7) -> bodies.Health:
    return health("physics", pid=pid, loop=loop_report(10_000, misses, rate_hz=rate_hz))


def test_a_miss_is_written_once_what_follows_it_included_and_no_more_often_than_agreed(directory: Path) -> None:
    files = IncidentFiles(directory, directory / "flights")
    assert files.reason_to_write(0.0, {"physics": _missed(3)}, {}) == ""  # before we came: not ours to tell
    assert files.reason_to_write(0.2, {"physics": _missed(3)}, {}) == ""
    assert files.reason_to_write(0.4, {"physics": _missed(5)}, {}) == ""  # what follows is waited for
    assert files.reason_to_write(0.8, {"physics": _missed(5)}, {}) == ""
    assert files.reason_to_write(0.9, {"physics": _missed(6)}, {}) == "physics: 2 ticks missed"
    assert files.reason_to_write(1.0, {"physics": _missed(6)}, {}) == ""
    assert files.reason_to_write(2.0, {"physics": _missed(9)}, {}) == ""  # too soon
    assert files.reason_to_write(0.9 + incident_files.APART_S, {"physics": _missed(9)}, {}) == "physics: 3 ticks missed"
    assert (
        files.reason_to_write(30.0, {"physics": _missed(1, pid=8)}, {}) == ""
    )  # started again: what it missed in that is known
    assert files.reason_to_write(60.0, {"physics": _missed(90, rate_hz=36.0, pid=9)}, {}) == ""  # a picture
    assert files.reason_to_write(61.0, {}, {"physics": "ended by signal 9"}) == ""
    assert files.reason_to_write(61.6, {}, {}) == "physics: ended by signal 9"


def test_a_file_has_all_loops_and_tells_its_worst_tick(directory: Path) -> None:
    for name, over_us in (("physics", 700), ("haptics", 20)):
        ring = FlightRing(1000.0, ("a",))
        ring.share(directory / f"{name}.flight")
        for k in range(50):
            ended = (k + 1) * MS + (over_us * 1000 if k == 30 else -500_000)
            ring.write(k, k * MS, k * MS, ended, 0, (1,))
    files = IncidentFiles(directory, directory / "flights")
    path = files.write("physics: 1 ticks missed", ())
    assert path.name.endswith("-late-00000700us.npz")
    assert path.stat().st_mode & 0o077 == 0
    assert {flight.name: len(flight.rows) for flight in read_file(path).flights} == {"physics": 50, "haptics": 50}


def test_the_newest_and_the_worst_are_kept(directory: Path) -> None:
    files = IncidentFiles(directory, directory / "flights")
    made = [f"20260101-0000{k:02d}-late-{(k * 37) % 60:08d}us.npz" for k in range(60)]
    for name in made:
        (files.directory / name).touch()
    newest = files.write("x", ()).name
    left = {path.name for path in files.directory.iterdir()}
    worst = sorted(made, key=lambda name: name[-14:])[-incident_files.WORST :]
    assert left == {newest, *made[-incident_files.NEWEST + 1 :], *worst}


def test_what_was_written_stays_where_the_clock_is_set_back(directory: Path) -> None:
    files = IncidentFiles(directory, directory / "flights")
    for k in range(30):
        (files.directory / f"29990101-0000{k:02d}-late-00000007us.npz").touch()
    written = [files.write("x", ()) for _ in range(2)]
    assert all(path.exists() for path in written), "of names that sort after it there are more than are kept"
    assert len(list(files.directory.iterdir())) <= incident_files.NEWEST + incident_files.WORST + len(written)


#: Takes its core from whoever has no priority for a third of a second, again and again.
_HOG = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
for _ in range(3):
    until = time.monotonic() + 0.33
    while time.monotonic() < until: pass
    time.sleep(0.1)
"""
#: The floor where SCHED_FIFO is refused.
_ORDINARY = """
import os, sys
from pathlib import Path
from trocar.services.supervisor.diagnosis import core_sleepers
core_sleepers.pin_above_all = lambda core: os.sched_setaffinity(0, {core})
core_sleepers.main(Path(sys.argv[1]))
"""


@pytest.mark.skipif(not Path("/proc/self/schedstat").is_file(), reason="this kernel does not count waiting")
@pytest.mark.skipif(not fifo_is_granted(), reason="this system refuses SCHED_FIFO")
def test_who_waits_for_its_core_does_not_blame_the_machine(directory: Path) -> None:
    core = max(os.sched_getaffinity(0))
    Phases(directory / PHASES, create=True)
    watcher = subprocess.Popen([sys.executable, "-c", _ORDINARY, str(directory)])
    try:
        eventually(lambda: _ticks(directory / f"floor{core}.flight") > 5, 60.0)
        subprocess.run([sys.executable, "-c", _HOG, str(core)], check=True)
        eventually(lambda: _longest_wait_ns(directory / f"floor{core}.flight") > 200 * MS)
    finally:
        watcher.kill()
        watcher.wait()
    flight = read_ring(directory / f"floor{core}.flight")
    assert flight is not None
    row = int((flight.column("ended_ns") - flight.column("began_ns")).argmax())
    assert flight.column("ended_ns")[row] - flight.column("due_ns")[row] > 200 * MS, "so late it was"
    assert flight.column("began_ns")[row] - flight.column("due_ns")[row] < 100 * MS, "and so late it was woken"
    assert not flight.column("ran_ns").any(), "nobody takes the waiting off once more"


def _longest_wait_ns(path: Path) -> int:
    flight = read_ring(path)
    return 0 if flight is None else int((flight.column("ended_ns") - flight.column("began_ns")).max(initial=0))


def test_the_machines_share_of_lost_ticks_is_by_core(directory: Path) -> None:
    rings = [FlightRing(100.0) for _ in range(2)]
    floor = MachineFloor(directory)
    for core, ring in enumerate(rings):
        ring.share(directory / f"floor{core}.flight")
    for second in range(3):
        for tick in range(100):
            due = (100 * second + tick + 1) * 10 * MS
            for every, ring in zip((10, 20), rings, strict=True):
                woke = due + (3 * MS if tick % every == 0 else 50_000)
                ring.write(tick, due, woke, woke, 0, ())
        floor.look(float(second))
    assert [floor.share(core) for core in (0, 1, 2, None)] == [0.1, 0.05, 0.0, 0.0]


@pytest.mark.parametrize(
    ("others", "found"), [("FIFO 80", {"haptics", "physics"}), ("nice -20", {"physics"}), ("DEADLINE 30 %", set())]
)
def test_sleepers_speak_for_loops_below_them_only(others: str, found: set[str]) -> None:
    def said(had: str) -> bodies.Health:
        fact = bodies.RealtimeFact(name="scheduling", asked="FIFO 60", had=had, ok=True)
        return bodies.Health(process="physics", pid=7, state="ready", realtime=(fact,))

    assert below_sleepers({"physics": said("FIFO 60"), "haptics": said(others)}) == found


@pytest.mark.parametrize(("below_loops", "late"), [(False, 2), (True, 1)])
def test_below_loops_with_deadlines_only_what_nobody_of_the_rig_had_is_the_machines(
    directory: Path, *, below_loops: bool, late: int
) -> None:
    ring = FlightRing(100.0)
    ring.share(directory / "floor1.flight")
    for tick, (late_ns, waited_ns) in enumerate([(40_000, 0), (3 * MS, 3 * MS - 50_000), (4 * MS, 10_000)]):
        due = 10 * MS * (tick + 1)
        ring.write(tick, due, due + late_ns, due + late_ns, waited_ns, ())
    core = CoreLateness()
    core.take(directory / "floor1.flight", 1.0, without_waits=below_loops)
    counted = Latencies.of(core.counts.body())
    assert (counted.total, counted.late) == (3, late)


def test_a_loop_with_a_deadline_stands_above_the_watchers() -> None:
    def had(text: str) -> dict[str, bodies.Health]:
        fact = bodies.RealtimeFact(name="scheduling", asked="FIFO 60", had=text, ok=False)
        return {"physics": bodies.Health(process="physics", pid=7, state="ready", realtime=(fact,))}

    assert has_deadline_loops(had("DEADLINE 70 % of a core; fifo: refused"))
    assert not has_deadline_loops(had("FIFO 60"))
    assert not has_deadline_loops(had("nice -20, slice 0.1 ms; fifo: refused; deadline: DEADLINE refused"))


def test_metrics_and_dashboard_tell_the_same_of_stages_threads_and_floor() -> None:
    meter = LoopMeter(1000.0, ("solve", "send"))
    times = StageTimes(meter.flight)
    heard = Heard.nothing(2.0)
    for report in range(30):
        for k in range(100):
            meter.flight.write(k, 0, 0, 0, 0, (200_000 if k else 700_000, 20_000))
        body = health("physics", uptime_s=1.0 + report / 10, loop=loop_report(100 * report))
        body = bodies.Health(**{f: getattr(body, f) for f in body.__struct_fields__} | {"stages": times.take()})
        heard.take(body)
    solve, send = heard.stage_rows()
    assert (solve.name, send.name) == ("solve", "send")
    assert (solve.p50_us, send.p50_us) == (pytest.approx(200, rel=0.15), pytest.approx(20, rel=0.15))
    assert solve.max_us == pytest.approx(700)  # not a bucket's edge
    assert solve.p99_us <= solve.max_us
    floor = {1: Latencies.of(histogram([40_000] * 99 + [2 * MS]))}
    counts = {"physics": Counts("physics", "", 500, 20, 3 * 10**9, 10**8)}
    observed = Report(
        {core: Row(n, n) for core, n in floor.items()}, {name: Row(n, None) for name, n in counts.items()}
    )
    state = bodies.SupervisorState(state=RigState.RUNNING)
    source = RigSource(state, {"physics": body}, observed)
    text = prometheus_client.generate_latest(registry(lambda: source)).decode()
    values = dict(line.rsplit(" ", 1) for line in text.splitlines() if not line.startswith("#"))
    assert float(values['trocar_stage_seconds_count{loop="physics",stage="solve"}']) == 3000
    assert float(values['trocar_stage_seconds_sum{loop="physics",stage="solve"}']) == pytest.approx(
        30 * 99 * 2e-4 + 30 * 7e-4
    )
    below = {float(key.partition('le="')[2].partition('"')[0]): float(value) for key, value in values.items()
             if key.startswith("trocar_stage_seconds_bucket") and 'stage="solve"' in key}  # fmt: skip
    assert below[min(edge for edge in below if edge > 2.0e-4)] == 2970
    assert below[max(edge for edge in below if edge < 2.0e-4)] == 0
    assert below[float("inf")] == 3000
    assert 7e-4 <= float(values['trocar_stage_max_seconds{loop="physics",stage="solve"}']) <= 1.25 * 7e-4
    assert float(values['trocar_machine_lateness_max_seconds{core="1"}']) == 2e-3
    worst_ns = {what: getattr(heard.health.loop, what).max_ns for what in ("lateness", "period", "work")}
    for what, ns in worst_ns.items():
        assert float(values[f'trocar_loop_{what}_max_seconds{{loop="physics"}}']) == ns / 1e9
    assert float(values['trocar_context_switches_total{kind="wanted",service="physics"}']) == 500
    assert float(values['trocar_context_switches_total{kind="preempted",service="physics"}']) == 20
    assert float(values['trocar_processor_seconds_total{service="physics"}']) == 3.0
    assert float(values['trocar_machine_lateness_seconds_count{core="1"}']) == 100
    assert float(values['trocar_machine_lateness_seconds_bucket{core="1",le="0.001"}']) == 99
