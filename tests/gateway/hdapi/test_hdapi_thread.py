"""The callback in the library's own 1 kHz thread: beside a busy interpreter, and through the gateway's process."""

from __future__ import annotations

import ctypes
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.gateway.devices.bench import BenchUnavailable
from tests.gateway.hdapi.hdapi_bench import HdapiBench
from tests.gateway.hdapi.hdapi_library import HdapiStandIn
from tests.gateway.kicks import kicks_n
from tests.gateway.rig_bench import RATE_LIMIT_N_S, Bench, forces
from tests.patience import PATIENCE_S
from trocar.services.gateway.drivers import phantom_hdapi

FORCE_N = 2.0


@pytest.fixture
def standin(tmp_path: Path) -> Iterator[HdapiStandIn]:
    try:
        with HdapiStandIn.compiled(tmp_path, threaded=True) as library:
            yield library
    except BenchUnavailable as reason:
        pytest.skip(str(reason))


@pytest.fixture
def bench(standin: HdapiStandIn, monkeypatch: pytest.MonkeyPatch) -> Iterator[HdapiBench]:
    # Two ordinary threads: either may be kept from running for longer than a rig's are. What silence comes to is
    # tested where time passes tick by tick.
    monkeypatch.setattr(phantom_hdapi, "_START_S", PATIENCE_S)
    monkeypatch.setattr(phantom_hdapi, "_SILENT_READS", round(1e3 * PATIENCE_S))
    arms = HdapiBench(standin)
    arms.open()
    yield arms
    arms.close()


def _until(condition: Callable[[], bool], doing: Callable[[], None] = lambda: time.sleep(0.001)) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "it never came to that"
        doing()


def test_the_callback_needs_no_interpreter(bench: HdapiBench) -> None:
    _until(lambda: bench.left.calibrated, lambda: bench.run(1, (0.0,) * 3, (0.0,) * 3))
    with_the_lock = ctypes.PyDLL(None)  # calls of a PyDLL keep the interpreter's lock
    end = time.monotonic() + PATIENCE_S
    frames = called = 0
    while called <= frames + 10:  # one that needs the lock would be called once, as it is let go
        assert time.monotonic() < end, "it is not called"
        frames = bench.standin.look(1).frames
        with_the_lock.usleep(300_000)
        called = bench.standin.look(1).frames
    assert bench.force_n(1) == 0.0, "nobody has given an order for long"


def test_an_order_reaches_the_hand_and_a_callback_that_overruns_is_counted_not_fatal(bench: HdapiBench) -> None:
    order = (0.0, 0.0, 0.1)
    _until(lambda: bench.applied(1)[2] > 0.0, lambda: bench.run(1, order, order))
    bench.c.standin_overrun(3000)
    arm = bench.left.arm
    assert arm is not None
    late = arm.cell.late
    _until(lambda: arm.cell.late > late, lambda: bench.run(1, order, order))
    bench.c.standin_overrun(0)
    assert bench.left.fault == bench.right.fault == ""


def test_an_arm_is_opened_anew_beside_the_librarys_thread(bench: HdapiBench) -> None:
    free = (0.0, 0.0, 0.0)
    _until(lambda: bench.left.calibrated and bench.right.calibrated, lambda: bench.run(1, free, free))
    bench.c.standin_pull(1)
    _until(lambda: bool(bench.left.fault), lambda: bench.run(1, free, free))
    bench.c.standin_unplug(1, 0)
    bench.c.standin_init_ms(50)
    bench.left.clear_fault()
    _until(lambda: not bench.left.is_reopening and bench.left.calibrated, lambda: bench.run(1, free, free))
    order = (0.0, 0.0, 0.1)
    _until(lambda: bench.applied(1)[2] > 0.0 and bench.applied(2)[2] > 0.0, lambda: bench.run(1, order, order))
    assert bench.standin.look(1).openings == 2
    assert bench.left.fault == bench.right.fault == ""


def test_the_last_to_leave_ends_the_thread(bench: HdapiBench) -> None:
    bench.close()
    frames = bench.standin.look(1).frames
    time.sleep(0.02)
    assert bench.standin.look(1).frames == frames


def test_the_thread_runs_one_above_a_loop_that_has_become_real_time(bench: HdapiBench) -> None:
    """It was started while the process was an ordinary one, and shares its core."""
    priority = 10
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        pytest.skip("this user may not be real-time")
    try:
        _until(lambda: bool(_real_time_threads()), lambda: bench.run(1, (0.0,) * 3, (0.0,) * 3))
        assert _real_time_threads() == [priority + 1]
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _real_time_threads() -> list[int]:
    """Return the priorities of all threads of this process that are real-time, but for the one that asks."""
    others = {int(task.name) for task in Path("/proc/self/task").iterdir()} - {threading.get_native_id()}
    real_time = [each for each in others if os.sched_getscheduler(each) == os.SCHED_FIFO]
    return [os.sched_getparam(each).sched_priority for each in real_time]


def _assert_never_a_kick(rig: Bench) -> None:
    """What the library's thread applied changes at the rig's rate; the gateway hears of it at its own ticks."""
    sampled_s = 1e-9 * np.array([frame.origin_ns for frame in rig.frames])
    steps_n = kicks_n(forces(rig.frames))
    assert len(steps_n) > 100
    assert (steps_n <= RATE_LIMIT_N_S * (np.diff(sampled_s) + 0.003)).all()


def test_a_gateway_process_pushes_through_the_library_and_lets_go(standin: HdapiStandIn, tmp_path: Path) -> None:
    rig = Bench(tmp_path)
    try:
        text = yaml.safe_load(rig.rig_file.read_text())
        text["gateway"]["instruments"][0]["arm"] = rig.arm("phantom_hdapi", library=str(standin.path))
        rig.rig_file.write_text(yaml.safe_dump(text))
        gateway = rig.gateway()
        rig.haptics(FORCE_N)
        rig.until(lambda i: bool(np.linalg.norm(i.applied_force_n) > 0.99 * FORCE_N))
        moved = rig.frames[-1].body.instruments[0]
        assert moved.position_m[2] > 0.5 * FORCE_N / 300.0, "the hand of the stand-in gives way upward"
        os.kill(gateway.pid, signal.SIGSTOP)
        time.sleep(0.3)
        os.kill(gateway.pid, signal.SIGCONT)
        rig.until(lambda i: i.state != "active")
        rig.until(lambda i: i.state == "active" and not i.fault)
        _assert_never_a_kick(rig)
        gateway.terminate()
        assert gateway.wait(PATIENCE_S) == 0
    finally:
        rig.close()
