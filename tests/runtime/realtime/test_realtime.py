"""What could not be had is said, not hidden."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from trocar.services.runtime.realtime import realtime


def _in_child(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=True)
    return done.stdout.strip()


def test_every_thread_of_the_bus_runs_as_the_process_does() -> None:
    """Set up first, context second: the I/O threads inherit the class. (The other order is the classic mistake.)"""
    code = (
        "from trocar.services.runtime.realtime import realtime; facts, _ = realtime.set_up(0, 10)\n"
        "import zmq; context = zmq.Context(); socket = context.socket(zmq.PUB); socket.bind('inproc://x')\n"
        "fact = realtime.read_back(); print(facts[1].ok, fact.ok, fact.had); context.destroy(linger=0)"
    )
    allowed, same, had = _in_child(code).split(" ", 2)
    if allowed != "True":
        pytest.skip("this machine refuses SCHED_FIFO")
    assert same == "True"
    assert had.count("FIFO 10") >= 3


def test_a_core_that_is_not_there_is_reported() -> None:
    fact = realtime.set_up(4095, None)[0][0]
    assert not fact.ok
    assert "may use" in fact.had


def test_a_niceness_that_is_refused_is_reported_and_the_process_goes_on() -> None:
    code = (
        "import os; from trocar.services.runtime.realtime import realtime\n"
        "os.geteuid() == 0 and os.setuid(65534)\n"
        "fact = realtime.set_up(None, None, -10)[0][1]; print(fact.ok, fact.asked, '|', fact.had)"
    )
    assert _in_child(code) == f"False OTHER, nice -10 | OTHER, nice {os.nice(0)}"


def test_a_process_that_is_nicer_than_asked_is_told() -> None:
    code = (
        "import os; os.nice(7); from trocar.services.runtime.realtime import realtime\n"
        "print(realtime.set_up(None, None, 0)[0][1].ok)"
    )
    assert _in_child(code) == "False"


def test_cores_are_kept_awake_for_as_long_as_a_process_lives(tmp_path: Path) -> None:
    """The kernel takes the request back when the file is closed, so it has to stay open, and may not be handed on."""
    device = tmp_path / "cpu_dma_latency"
    device.touch()
    code = (
        "import os, subprocess, sys; from pathlib import Path; from trocar.services.runtime.realtime import realtime\n"
        f"path = Path({str(device)!r}); fact = realtime.keep_awake(path)\n"
        "held = [os.readlink(each) for each in Path('/proc/self/fd').iterdir() if each.is_symlink()]\n"
        "look = 'import os; print(*(os.path.realpath(f\"/proc/self/fd/{n}\") for n in range(3, 64)))'\n"
        "theirs = subprocess.run([sys.executable, '-c', look], stdout=-1, text=True, close_fds=False).stdout\n"
        "print(fact.ok, str(path) in held, str(path) in theirs)"
    )
    assert _in_child(code) == "True True False"
    assert device.read_bytes() == bytes(4)


def test_cores_that_sleep_are_reported(tmp_path: Path) -> None:
    fact = realtime.keep_awake(tmp_path / "nothing")
    assert not fact.ok
    assert "No such file" in fact.had


@pytest.mark.parametrize(("limit", "refusal"), [(8 << 20, "8 MiB"), (1 << 30, "1024 MiB"), (2 << 30, ""), (None, "")])
def test_memory_is_locked_where_there_is_room_for_what_comes(
    limit: int | None, refusal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Physics locks 983 MB: under a limit of 1 GiB an allocation in its loop would fail sooner or later."""
    asked: list[int] = []

    def mlockall(flags: int) -> int:
        asked.append(flags)
        return 0

    monkeypatch.setattr(realtime, "_libc", SimpleNamespace(mlockall=mlockall))
    monkeypatch.setattr(realtime, "lockable_bytes", lambda: limit)
    fact = realtime._lock_memory()
    assert (fact.ok, bool(asked)) == (not refusal, not refusal)
    assert refusal in fact.had


def test_who_has_no_right_to_lock_more_may_lock_the_limit() -> None:
    code = (
        "import os, resource; from trocar.services.runtime.realtime import realtime\n"
        "hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]\n"
        "resource.setrlimit(resource.RLIMIT_MEMLOCK, (1 << 20, hard))\n"
        "os.geteuid() == 0 and os.setuid(65534)\n"
        "print(realtime.lockable_bytes(), resource.getrlimit(resource.RLIMIT_MEMLOCK)[0])"
    )
    assert _in_child(code) == f"{1 << 20} {1 << 20}"


def test_a_rig_may_let_its_cores_sleep() -> None:
    code = (
        "from trocar.services.runtime.realtime import realtime\n"
        "for awake in (False, True):\n"
        "    print('idle cores' in [fact.name for fact in realtime.set_up(None, 10, awake=awake)[0]])"
    )
    assert _in_child(code).split() == ["False", "True"]


def test_numerics_libraries_get_one_thread() -> None:
    out = _in_child("import trocar.services.runtime, os; print(os.environ['OPENBLAS_NUM_THREADS'])")
    assert out == os.environ.get("OPENBLAS_NUM_THREADS", "1")


_FAULTS = """
import ctypes, msgpack, resource
from trocar.services.runtime.realtime import realtime
{prepare}
libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
slow = 0
for _ in range(128):
    libc.malloc(16384 - 16)  # kept: moves the heap's top, so that every place of a buffer beside it is tried
    faults = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        msgpack.packb({{"a": 1}})  # takes 256 kB and gives them back
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    slow += min(faults[1:]) > 0
print(slow)
"""


def test_memory_that_a_tick_frees_stays_with_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """A heap that is trimmed and grown in each call costs a millisecond a call where pages are huge and locked."""
    monkeypatch.setenv("GLIBC_TUNABLES", "glibc.malloc.hugetlb=1")
    if int(_in_child(_FAULTS.format(prepare=""))) == 0:
        pytest.skip("this C library does not trim its heap here, so there is nothing to keep")
    kept = int(_in_child(_FAULTS.format(prepare="assert realtime.keep_heap().ok")))
    assert kept == 0, f"at {kept} of 128 places every call has the kernel give it its memory anew"
