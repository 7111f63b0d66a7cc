"""Cost of the emulated drives: a frame on their bus, and both drives of the stub rig in their process.

python benchmarks/bench_drives.py
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np
from report import Row, measure, parse, write_report

from trocar.services.gateway.can.local_bus import LocalBus
from trocar.services.gateway.instruments.instrument import Instrument, build_instruments
from trocar.services.gateway.servo.servo_arrays import HANDLE_SIZE
from trocar.services.runtime.config import config
from trocar.services.runtime.realtime import realtime

SECONDS, WARM_S = 20.0, 2.0
CORE, PRIORITY = 1, 55
ALL_LIMIT = 0.04
MULTICAST = {"interface": "udp_multicast", "channel": "239.74.163.2", "port": 43119, "hop_limit": 0, "fd": False}
MESSAGE = can.Message(arbitration_id=0x2E, data=bytes(4), is_extended_id=False)


def frames() -> list[Row]:
    """Return what a frame costs on the drives' bus and on python-can's multicast, which they had before."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
    buses = {"local": [LocalBus(end) for end in ends], "multicast": [can.Bus(**MULTICAST) for _ in range(2)]}

    def through(name: str) -> None:
        first, second = buses[name]
        first.send(MESSAGE)
        while second.recv(0.0) is None:
            pass
        if name == "multicast":
            first.recv(0.0)  # it hears itself

    timings = measure({name: (lambda name=name: through(name)) for name in buses}, samples=5000)
    for bus in (*buses["local"], *buses["multicast"]):
        bus.shutdown()
    return [Row.from_timing(f"a frame sent and received, {name}", timing) for name, timing in timings.items()]


def processor_s(pid: int) -> float:
    """Return the processor time of the main thread of a process."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) * 1e-9


def children() -> set[int]:
    return {int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()}


def exchange(instruments: list[Instrument], seconds: float) -> None:
    """Serve the handles in turn at 1 kHz as the gateway does, under torque."""
    read, due_s, end_s = np.zeros(HANDLE_SIZE), time.monotonic(), time.monotonic() + seconds
    while due_s < end_s:
        for instrument in instruments:
            due_s += 1e-3
            time.sleep(max(0.0, due_s - time.monotonic()))
            instrument.grasp.read(time.monotonic_ns(), read)
            instrument.grasp.write(0.05)


@contextmanager
def busy_core() -> Iterator[None]:
    """Keep the core of the drives from going idle, as the others of a rig do; it gives way to whoever wants to run."""
    code = f"import os; os.nice(19); os.sched_setaffinity(0, {{{CORE}}})\nwhile True: pass"
    process = subprocess.Popen([sys.executable, "-c", code])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def floor() -> float:
    """Return what a process takes that only wakes as often."""
    code = (
        "import sys, time; from trocar.services.runtime.realtime import realtime\n"
        f"realtime.set_up({CORE}, {PRIORITY}); due = time.monotonic()\n"
        "while True:\n    due += 2e-3; time.sleep(max(0.0, due - time.monotonic()))"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    try:
        time.sleep(WARM_S)
        began_s, spent_s = time.monotonic(), processor_s(process.pid)
        time.sleep(SECONDS)
        return (processor_s(process.pid) - spent_s) / (time.monotonic() - began_s)
    finally:
        process.kill()
        process.wait()


def processes() -> list[Row]:
    """Return what the drives of the stub rig take of a core while both handles are served."""
    realtime.set_up(0, 80)
    instruments, before = build_instruments(config.load_rig("stub").gateway), children()
    try:
        for instrument in instruments:
            instrument.grasp.open()
        for instrument in instruments:
            instrument.grasp.enable()
        exchange(instruments, WARM_S)
        began_s, spent_s = time.monotonic(), -sum(processor_s(pid) for pid in children() - before)
        exchange(instruments, SECONDS)
        spent_s += sum(processor_s(pid) for pid in children() - before)
        share, n = spent_s / (time.monotonic() - began_s), len(children() - before)
        faults = [instrument.grasp.fault for instrument in instruments]
        assert not any(faults), faults
    finally:
        for instrument in instruments:
            instrument.close()
    return [Row("both drives, of a core", share, "1", ALL_LIMIT), Row("processes", n, "1", 1)]


def main() -> None:
    parse(__doc__)
    notes = (
        "Frames are interleaved. The drives run as the stub rig has them, under torque in closed loop at 500 Hz, on a "
        "core that is kept awake. The floor is a Python process that only wakes 500 times a second."
    )
    rows = frames()
    with busy_core():
        rows += [*processes(), Row("floor, of a core", floor(), "1")]
    write_report("drives", "Emulated drives", rows, notes)


if __name__ == "__main__":
    main()
