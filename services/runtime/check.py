"""Is a process well? ``python -m services.runtime.check physics`` exits 0 if it says so on the bus: for containers."""

from __future__ import annotations

import os
import sys
import time

from services.runtime import config
from services.runtime.errors import UserError
from services.runtime.process import parse
from services.runtime.zmq_bus import ZmqBus

_WELL = ("ready", "running", "degraded")
_PATIENCE_NS = 2_000_000_000


def check(process: str, rig: str, overrides: tuple[str, ...]) -> str:
    """Return the state that `process` reports, or "silent"."""
    topic = "supervisor.state" if process == "supervisor" else f"{process}.health"
    bus = ZmqBus(config.load_rig(rig, overrides).transport, reads=[topic])
    try:
        deadline = time.monotonic_ns() + _PATIENCE_NS
        while bus.wait(topic, deadline):
            for frame in bus.drain(topic):
                return str(frame.body.state)
        return "silent"
    finally:
        bus.close()


def main(arguments: list[str]) -> int:
    """Return 0 if the process named first is well; say what it reports otherwise."""
    os.nice(19)  # it looks at loops that it must not disturb
    options = parse("runtime.check", arguments[1:])
    try:
        state = check(arguments[0], options.rig, options.overrides)
    except UserError as error:
        state = str(error)
    if state in _WELL:
        return 0
    print(f"{arguments[0]}: {state}", file=sys.stderr)  # noqa: T201
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
