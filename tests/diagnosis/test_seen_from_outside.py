"""What is seen from outside of a rig: wake-ups by the machine alone, and threads as the kernel counts them."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import prometheus_client
import pytest

import trocar.protocol.bodies as bodies
from tests.real_time import fifo_is_granted
from tests.supervisor.made_up import MS, health, loop_report
from trocar.services.diagnosis.core_sleepers import watching
from trocar.services.diagnosis.thread_usage import Counts, ThreadUsage, UsageRow
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.measures.flights import read_ring
from trocar.services.runtime.measures.stage_times import StageTimes
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.dashboard import Heard
from trocar.services.supervisor.page.metrics import RigSource, registry

#: The kernel adds up what a thread has run, and what it has waited, when it is switched, or as its timer ticks.
TICK_NS = 10 * MS


def eventually(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it did not happen"
        time.sleep(0.02)


def _floor(directory: Path, parent: str = "") -> subprocess.Popen[bytes]:
    code = f"import subprocess, sys; {parent}" if parent else ""
    command = [sys.executable, "-m", "trocar.services.diagnosis.core_sleepers", str(directory)]
    if not code:
        return subprocess.Popen(command)
    return subprocess.Popen(
        [sys.executable, "-c", f"{code}; subprocess.Popen({command!r}); sys.stdin.read()"], stdin=subprocess.PIPE
    )


def _ticks(path: Path) -> int:
    flight = read_ring(path)
    return 0 if flight is None else int(flight.column("tick").max(initial=0))


def test_the_floor_watches_every_core_and_ends_with_who_started_it(private_folder: Path) -> None:
    starter = _floor(private_folder, parent="pass")
    cores = sorted(os.sched_getaffinity(0))
    rings = [private_folder / f"floor{core}.flight" for core in cores]
    eventually(lambda: all(_ticks(ring) > 20 for ring in rings))
    flight = read_ring(rings[0])
    assert flight is not None
    assert flight.cores == (cores[0],)
    assert (flight.column("began_ns") >= flight.column("due_ns")).all()  # nobody wakes before the time
    assert starter.stdin is not None
    starter.stdin.close()
    starter.wait()
    eventually(lambda: not Path(f"/proc/{flight.pid}").exists() or "Z" in _state(flight.pid))


def test_who_looks_has_every_core_watched_and_leaves_nothing(private_folder: Path) -> None:
    rings = [private_folder / f"floor{core}.flight" for core in sorted(os.sched_getaffinity(0))]
    with watching(private_folder):
        eventually(lambda: all(_ticks(ring) > 5 for ring in rings))
    assert not list(private_folder.glob("*.flight"))


def _state(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return "Z"


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
        watch.sample(10.0, pids)
        inner = _woken(sleeper.pid), _busy_ns(spinner.pid)
        watch.sample(10.5, pids)  # too early: not looked at
        assert not any(row.lately for row in watch.report().values())
        eventually(lambda: _woken(sleeper.pid) > inner[0] + 100 and _busy_ns(spinner.pid) > inner[1] + 200 * MS)
        least = _woken(sleeper.pid) - inner[0], _busy_ns(spinner.pid) - inner[1]
        watch.sample(11.5, pids)
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
        alone.sample(0.0, {"parent": parent.pid})
        named.sample(0.0, {"child": grandchild, "parent": parent.pid})
        assert alone.report().keys() == {"parent"}
        assert named.report().keys() == {"parent", "child"}
        os.kill(grandchild, 9)
    finally:
        parent.kill()
        parent.wait()


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


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
from trocar.services.diagnosis import core_sleepers
core_sleepers.pin_above_all = lambda core: os.sched_setaffinity(0, {core})
core_sleepers.main(Path(sys.argv[1]))
"""


@pytest.mark.skipif(not Path("/proc/self/schedstat").is_file(), reason="this kernel does not count waiting")
@pytest.mark.skipif(not fifo_is_granted(), reason="this system refuses SCHED_FIFO")
def test_who_waits_for_its_core_does_not_blame_the_machine(private_folder: Path) -> None:
    core = max(os.sched_getaffinity(0))
    watcher = subprocess.Popen([sys.executable, "-c", _ORDINARY, str(private_folder)])
    try:
        eventually(lambda: _ticks(private_folder / f"floor{core}.flight") > 5, 60.0)
        subprocess.run([sys.executable, "-c", _HOG, str(core)], check=True)
        eventually(lambda: _longest_wait_ns(private_folder / f"floor{core}.flight") > 200 * MS)
    finally:
        watcher.kill()
        watcher.wait()
    flight = read_ring(private_folder / f"floor{core}.flight")
    assert flight is not None
    row = int((flight.column("ended_ns") - flight.column("began_ns")).argmax())
    assert flight.column("ended_ns")[row] - flight.column("due_ns")[row] > 200 * MS, "so late it was"
    assert flight.column("began_ns")[row] - flight.column("due_ns")[row] < 100 * MS, "and so late it was woken"
    assert not flight.column("ran_ns").any(), "nobody takes the waiting off once more"


def _longest_wait_ns(path: Path) -> int:
    flight = read_ring(path)
    return 0 if flight is None else int((flight.column("ended_ns") - flight.column("began_ns")).max(initial=0))


def test_metrics_and_dashboard_tell_the_same_of_stages_and_threads() -> None:
    meter = LoopMeter(1000.0, ("solve", "send"))
    times = StageTimes(meter.flight)
    heard = Heard(2.0)
    for report in range(30):
        for k in range(100):
            meter.flight.write(k, 0, 0, 0, 0, (200_000 if k else 700_000, 20_000))
        body = health("physics", uptime_s=1.0 + report / 10, loop=loop_report(100 * report))
        body = bodies.Health(**{f: getattr(body, f) for f in body.__struct_fields__} | {"stages": times.take_costs()})
        heard.take_report(body)
    solve, send = heard.stage_rows()
    assert (solve.name, send.name) == ("solve", "send")
    assert (solve.p50_us, send.p50_us) == (pytest.approx(200, rel=0.15), pytest.approx(20, rel=0.15))
    assert solve.max_us == pytest.approx(700)  # not a bucket's edge
    assert solve.p99_us <= solve.max_us
    threads = {"physics": UsageRow(Counts("physics", "", 500, 20, 3 * 10**9, 10**8), None)}
    state = bodies.SupervisorState(state=RigState.RUNNING)
    source = RigSource(state, {"physics": body}, threads)
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
    worst_ns = {what: getattr(heard.health.loop, what).max_ns for what in ("lateness", "period", "work")}
    for what, ns in worst_ns.items():
        assert float(values[f'trocar_loop_{what}_max_seconds{{loop="physics"}}']) == ns / 1e9
    assert float(values['trocar_context_switches_total{kind="wanted",service="physics"}']) == 500
    assert float(values['trocar_context_switches_total{kind="preempted",service="physics"}']) == 20
    assert float(values['trocar_processor_seconds_total{service="physics"}']) == 3.0
