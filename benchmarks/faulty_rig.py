"""A supervisor whose processes misbehave when told: ``python benchmarks/faulty_rig.py [options of the supervisor]``.

On SIGUSR1 the loops publish each frame `FLOOD` times for half a second; the recorder's next write takes as long, and
the file `$FAULTY_BEGAN` says when that began, in ns of the monotonic clock. On the first real-time signals a loop
stands still for `STALLS_MS`, and the file says for how many ns. Until then they are the rig's own processes.
"""

from __future__ import annotations

import argparse
import os
import runpy
import signal
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
sys.path.insert(0, str(HERE.parents[1]))

FLOOD, LASTS_S = 10, 0.5
STALLS_MS = (20, 100, 400)
NAME, MODULE, BEGAN = "FAULTY_NAME", "FAULTY_MODULE", "FAULTY_BEGAN"


class Fault:
    """Lasts for a while after each SIGUSR1."""

    def __init__(self) -> None:
        self._until_s = 0.0
        self.is_new = False
        signal.signal(signal.SIGUSR1, self._begin)
        for k, length_ms in enumerate(STALLS_MS):
            signal.signal(signal.SIGRTMIN + k, partial(_stand_still, 1e-3 * length_ms))

    def _begin(self, *_: object) -> None:
        self._until_s = time.monotonic() + LASTS_S
        self.is_new = True

    def left_s(self) -> float:
        """Return for how long it still lasts."""
        return self._until_s - time.monotonic()


def _stand_still(seconds: float, *_: object) -> None:
    began_ns = time.monotonic_ns()
    time.sleep(seconds)
    Path(os.environ[BEGAN]).write_text(str(time.monotonic_ns() - began_ns))


def flood(fault: Fault) -> None:
    """Publish each fast frame more than once."""
    from trocar.protocol import topic
    from trocar.services.runtime.bus.zmq_bus import ZmqBus

    publish = ZmqBus.publish

    def often(bus: ZmqBus, name: str, body: Any, **rest: Any) -> int:
        more = FLOOD - 1 if topic(name).rate_hz >= 1000.0 and fault.left_s() > 0.0 else 0
        for _ in range(more):
            publish(bus, name, body, **rest)
        return publish(bus, name, body, **rest)

    ZmqBus.publish = often  # type: ignore[assignment, method-assign]


def hold(fault: Fault) -> None:
    """Let the next write take as long as a fault lasts."""
    from trocar.services.recorder import disk

    write_at = disk.write_at

    def slowly(file: int, data: bytes, offset: int) -> None:
        if fault.is_new:
            fault.is_new = False
            Path(os.environ[BEGAN]).write_text(str(time.monotonic_ns()))
            time.sleep(LASTS_S)
        write_at(file, data, offset)

    disk.write_at = slowly


def supervise() -> int:
    """Run the supervisor with processes that can be told to misbehave."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_known_args()
    from trocar.services.supervisor import __main__ as supervisor
    from trocar.services.supervisor.crew.processes import TABLE

    path = os.pathsep.join((str(HERE.parent), str(HERE.parents[1])))
    table = tuple(
        replace(
            spec,
            module=HERE.stem,
            environment={**spec.environment, "PYTHONPATH": path, NAME: spec.name, MODULE: spec.module},
        )
        for spec in TABLE
    )
    supervisor.SessionOptions = partial(supervisor.SessionOptions, table=table)  # type: ignore[assignment, misc]
    return supervisor.main()


def main() -> int:
    """Be a process of the rig, or its supervisor."""
    module = os.environ.pop(MODULE, "")
    if not module:
        return supervise()
    (hold if os.environ[NAME] == "recorder" else flood)(Fault())
    runpy.run_module(module, run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
