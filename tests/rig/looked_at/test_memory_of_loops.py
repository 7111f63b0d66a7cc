"""What a loop needs it has: while it runs, none takes memory from the system, gives any back, or meets a new page.

Locked memory is populated when it is mapped, and a heap that is trimmed and grown again in every tick costs a
millisecond a tick. Counted by the kernel (perf), which slows nobody.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests import chromium
from tests.patience import PATIENCE_S
from tests.rig.conftest import Rig

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]

LOOPS = ("gateway", "haptics", "physics")
CALLS = ("brk", "mmap", "munmap", "madvise", "mremap", "mprotect")
EVENTS = ("page-faults", *(f"syscalls:sys_enter_{call}" for call in CALLS))
SECONDS = 3.0
#: A loop that meets new pages does so all the time; where the kernel has moved one, locked or not (compaction), it
#: faults once. System calls are a loop's own: of these there is none in any look.
LOOKS = 3


def test_no_loop_takes_or_returns_memory_while_it_runs(rig: Rig, request: pytest.FixtureRequest) -> None:
    """Its hands insert again meanwhile, and where there is a browser it opens the page."""
    observer = rig.observer
    observer.until(lambda: observer.is_up, PATIENCE_S, "running")
    observer.until(lambda: observer.samples[-1].state == "active", PATIENCE_S, "they move")
    pids = {name: rig.observer.pids()[name] for name in LOOPS}
    (pids["drives"],) = _children(pids["gateway"])
    for pid in pids.values():
        assert "\nTHP_enabled:\t0\n" in Path(f"/proc/{pid}/status").read_text(), "no page of theirs is made huge now"
    none = {name: dict.fromkeys(EVENTS, 0) for name in pids}
    for _ in range(LOOKS):
        counters = {name: _start_counting(pid) for name, pid in pids.items()}
        if chromium.find() is not None:
            request.getfixturevalue("browser")
        has_ended = lambda: all(each.poll() is not None for each in counters.values())  # noqa: B023, E731
        rig.observer.until(has_ended, 60.0 + SECONDS, "the counts")
        counts = {name: _counts(counter) for name, counter in counters.items()}
        if counts == none:
            break
        assert {name: count | {"page-faults": 0} for name, count in counts.items()} == none
    assert counts == none


def test_what_a_process_takes_is_counted() -> None:
    code = "import mmap, time\nprint(1, flush=True)\nwhile True: mmap.mmap(-1, 4096).write(b'x'); time.sleep(1e-3)"
    with subprocess.Popen(["python3", "-c", code], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            process.stdout.readline()
            counter = _start_counting(process.pid, seconds=0.3)
            counts = _counts(counter)
        finally:
            process.kill()
    mapped = counts["syscalls:sys_enter_mmap"]
    assert mapped >= 10
    assert counts["syscalls:sys_enter_munmap"] >= mapped - 1
    assert counts["page-faults"] >= mapped - 1


def _children(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _start_counting(pid: int, seconds: float = SECONDS) -> subprocess.Popen[str]:
    """Count `EVENTS` of every thread of a process for a while."""
    if shutil.which("perf") is None:
        pytest.skip("there is no perf here (Debian: linux-perf)")
    together = "{" + ",".join(EVENTS) + "}"  # as a group they are started and stopped at once
    command = ["perf", "stat", "-x,", "-e", together, "-p", str(pid), "--", "sleep", str(seconds)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def _counts(counter: subprocess.Popen[str]) -> dict[str, int]:
    """Return what was counted; skip where this kernel does not let this user count."""
    _, text = counter.communicate(timeout=300.0)
    rows = [line.split(",") for line in text.splitlines() if line.count(",") > 3]
    if counter.returncode != 0 or not all(row[0].isdigit() for row in rows) or len(rows) < len(EVENTS):
        pytest.skip(f"perf may not count here: {text.strip().splitlines()[-1:]}")
    return {row[2].partition(":u")[0]: int(row[0]) for row in rows}
