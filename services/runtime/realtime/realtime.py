"""Real-time set-up of a process, requested and granted; call it before the ZeroMQ context is made.

The order matters: threads inherit scheduling when they start, so a context made first keeps its I/O thread in the
ordinary class and the loaded p99 of a round trip goes from 86 to 1987 us.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import mmap
import os
import resource
import struct
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

import trocar.protocol.bodies as bodies
from trocar.services.runtime.realtime.autogroup import set_group_niceness
from trocar.services.runtime.realtime.scheduling import Scheduling, SchedulingRequest, own_threads
from trocar.services.start import start_up

_PR_SET_TIMERSLACK, _PR_SET_THP_DISABLE = 29, 41  # Linux: <linux/prctl.h>
_MCL_CURRENT, _MCL_FUTURE = 1, 2  # Linux: <sys/mman.h>
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of the GNU library for Linux: <malloc.h>
_LARGEST_MMAP_THRESHOLD = 32 << 20  # mallopt(3) refuses more than that on 64 bits (`DEFAULT_MMAP_THRESHOLD_MAX`)
#: Python maps memory for small objects, of up to 512 bytes, in arenas of 1 MiB, and unmaps an arena without objects. A
#: loop was seen to map one in three seconds; there is room for four. Larger objects lie in the heap, which was seen to
#: grow by 2 MiB in a minute; it gets room for four as well.
_ROOM_BYTES, _ARENA_BYTES, _OBJECT_BYTES = 4 << 20, 1 << 20, 448
#: ZeroMQ starts two threads, of which one was seen to use 360 kB.
_ZMQ_THREADS, _THREAD_ROOM_BYTES = 2, 1 << 20
#: Memory that a process must be allowed to lock: twice that of the largest, physics with 983 MB in the default scene.
LOCKED_BYTES = 2 << 30
#: File that limits the wake-up latency of cores, in us, while a process holds it open.
DMA_LATENCY = Path("/dev/cpu_dma_latency")
_libc = ctypes.CDLL(None, use_errno=True)
_libc.malloc.argtypes, _libc.malloc.restype = (ctypes.c_size_t,), ctypes.c_void_p
_libc.free.argtypes, _libc.free.restype = (ctypes.c_void_p,), None
_kept: list[bytes] = []


@dataclass(frozen=True, slots=True)
class Fact:
    """One property, requested and granted."""

    name: str
    asked: str
    had: str
    ok: bool

    def body(self) -> bodies.RealtimeFact:
        """Return the fact for the wire."""
        return bodies.RealtimeFact(name=self.name, asked=self.asked[:128], had=self.had[:256], ok=self.ok)


def set_up(
    core: int | None,
    priority: int | None,
    nice: int | None = None,
    share: float = 0.3,
    *,
    awake: bool = False,
) -> tuple[list[Fact], Scheduling | None]:
    """Pin the process, set its scheduling class and timer slack; return what was granted.

    Args:
        core: Processor to run on, None for any.
        priority: SCHED_FIFO priority 1..89, None for the ordinary class.
        nice: Niceness of an ordinary process.
        share: Share of a core that a real-time budget of the process' group has to cover.
        awake: Whether cores must not sleep while a process with a priority lives, see `keep_awake`.
    """
    scheduling = None
    if priority is not None:
        scheduling = Scheduling.request(SchedulingRequest(priority, share))
    facts = [
        _pin(core),
        _ordinary(nice) if scheduling is None else scheduling_fact(scheduling),
        _timer_slack(),
    ]
    if priority is not None:
        facts += [keep_heap(), _lock_memory()]
        keep_thread_room()
        if awake:
            facts.append(keep_awake())
    return facts, scheduling


def scheduling_fact(scheduling: Scheduling) -> Fact:
    """Return the requested and the granted scheduling class."""
    why = "".join(f"; {refusal}" for refusal in scheduling.refused)
    return Fact("scheduling", f"FIFO {scheduling.requested.priority}", scheduling.had + why, scheduling.is_fifo)


def keep_heap() -> Fact:
    """Make the heap keep freed memory for the next tick.

    Locked memory is populated when it is mapped. A heap that is trimmed and grown in every call (a packer's buffer of
    256 kB at an unlucky address, huge pages) costs a millisecond a call, as long as the process lives.
    """
    ok = _libc.mallopt(_M_TRIM_THRESHOLD, 2**31 - 1) and _libc.mallopt(_M_MMAP_THRESHOLD, _LARGEST_MMAP_THRESHOLD)
    return Fact("heap", "never trimmed", "never trimmed" if ok else "trimmed: mallopt refused", bool(ok))


def keep_object_room() -> list[bytes]:
    """Map room for small objects; it stays mapped for as long as the returned objects, two or more an arena, live."""
    objects = [bytes(_OBJECT_BYTES - sys.getsizeof(b"")) for _ in range(_ROOM_BYTES // _OBJECT_BYTES)]
    return objects[:: _ARENA_BYTES // (2 * _OBJECT_BYTES)]


def _keep_heap_room(n_bytes: int) -> None:
    """Let the heap of the calling thread, which is never trimmed, grow by what is not free yet of so many bytes."""
    _libc.free(_libc.malloc(n_bytes))


def keep_thread_room() -> None:
    """Map room for the threads that ZeroMQ starts next: a thread that ends leaves its heap to the next one.

    Without it their heaps grow by a page where another process connects (glibc malloc, `arena_get2`).
    """
    all_live = threading.Barrier(_ZMQ_THREADS)  # or a later one would take the heap of an earlier

    def grow() -> None:
        _keep_heap_room(_THREAD_ROOM_BYTES)
        all_live.wait()

    threads = [threading.Thread(target=grow, daemon=True) for _ in range(_ZMQ_THREADS)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()


def keep_awake(path: Path = DMA_LATENCY) -> Fact:
    """Request that no core sleeps while this process lives; idle cores then poll for work.

    A sleeping core wakes 10 to 100 us late, which is lost for the woken thread; also in a virtual machine, whose sleep
    is the host's. The request ends when the file is closed, by any end of the process
    (Documentation/power/pm_qos_interface.rst).
    """
    asked, said = "no core sleeps", ""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CLOEXEC)  # kept: closing it ends the request
        os.write(descriptor, struct.pack("=i", 0))
    except OSError as error:
        said = f"cores sleep: {path}: {error.strerror}"
    return Fact("idle cores", asked, said or asked, not said)


def freeze_garbage_collector() -> Fact:
    """Freeze present objects and switch the collector off; call this when a loop is compiled and about to run.

    The loop gets room for its own objects. Enabling the collector again uses Python's thresholds, not those of a start.
    """
    gc.collect()
    _kept.extend(keep_object_room())
    _keep_heap_room(_ROOM_BYTES)
    gc.freeze()
    start_up.over()
    gc.disable()
    return Fact("garbage collector", asked := "off, start-up objects frozen", asked, True)  # to count them takes 50 ms


def keep_pages() -> Fact:
    """Have the kernel make no more pages of this process huge; call this when a loop is about to run.

    Pages that are huge stay so. The kernel looks for others every ten seconds and copies each 2 MiB without being
    preempted (`khugepaged`), for half a millisecond in which no loop of that core runs. Processes that are forked later
    inherit this.
    """
    ok = _libc.prctl(_PR_SET_THP_DISABLE, 1, 0, 0, 0) == 0
    return Fact("huge pages", "as at start", "as at start" if ok else os.strerror(ctypes.get_errno()), ok)


def read_back() -> Fact:
    """Return the present scheduling class of every thread of this process, by the kernel."""
    had = [_class_of(thread) for thread in own_threads()]
    return Fact("threads", "one class for all", ", ".join(had), len({each.split()[0] for each in had}) == 1)


def _class_of(thread: int) -> str:
    policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    if policy == os.SCHED_OTHER:
        nice = os.getpriority(os.PRIO_PROCESS, thread)
        return f"OTHER {nice}"
    names = {os.SCHED_FIFO: "FIFO", os.SCHED_RR: "RR"}
    return f"{names.get(policy, '?')} {os.sched_getparam(thread).sched_priority}"


def _pin(core: int | None) -> Fact:
    if core is None:
        return Fact("core", "any", f"{sorted(os.sched_getaffinity(0))}", True)
    allowed = os.sched_getaffinity(0)
    if core not in allowed:
        return Fact("core", str(core), f"this process may use {sorted(allowed)} only", False)
    os.sched_setaffinity(0, {core})
    return Fact("core", str(core), f"{sorted(os.sched_getaffinity(0))}", True)


def _ordinary(nice: int | None) -> Fact:
    asked = nice or 0
    if asked:
        with contextlib.suppress(PermissionError):  # values below 0 need a permission
            os.setpriority(os.PRIO_PROCESS, 0, asked)
            set_group_niceness(asked)
    had = os.getpriority(os.PRIO_PROCESS, 0)
    return Fact("scheduling", f"OTHER, nice {asked}", f"OTHER, nice {had}", had <= asked)


def _timer_slack() -> Fact:
    ok = _libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0
    return Fact("timer slack", "1 ns", "1 ns" if ok else os.strerror(ctypes.get_errno()), ok)


def lockable_bytes() -> int | None:
    """Return the memory that this process may lock, None for all.

    The privilege is tested by locking a page under a limit of zero, as root in a container mostly lacks it.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if soft == resource.RLIM_INFINITY:
        return None
    with mmap.mmap(-1, mmap.PAGESIZE) as page:
        address = ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(page)))
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, hard))
        privileged = _libc.mlock(address, ctypes.c_size_t(mmap.PAGESIZE)) == 0
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (soft, hard))
    return None if privileged else soft


def _lock_memory() -> Fact:
    # MCL_FUTURE under a small memlock limit makes later allocations fail, so it is requested only with enough room.
    asked, limit = "all pages locked", lockable_bytes()
    if limit is not None and limit < LOCKED_BYTES:
        had = f"not locked: the memlock limit is {limit >> 20} MiB, {LOCKED_BYTES >> 20} are wanted"
        return Fact("memory", asked, had, False)
    ok = _libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0
    return Fact("memory", asked, "locked" if ok else f"not locked: {os.strerror(ctypes.get_errno())}", ok)
