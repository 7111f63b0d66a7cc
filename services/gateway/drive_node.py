"""An emulated drive on a real CAN bus, in its own process: ``python -m services.gateway.drive_node '{...}'``.

The gateway spawns one for every simulated handle, tells it its task as JSON, and ends it by closing its standard input;
a gateway that dies closes it too.
"""

from __future__ import annotations

import os
import select
import signal
import sys
from pathlib import Path
from typing import Any

import can
import msgspec

from services.gateway import canbus, hand_motion
from services.gateway.emulated_drive import ESTIMATE_S, CanFrame, EmulatedDrive, Handle
from services.runtime import log, realtime
from services.runtime.errors import UserError
from services.runtime.loop import LoopMeter, ticks


class Task(msgspec.Struct):
    """What one node does."""

    bus: dict[str, Any]
    node: int
    watchdog_s: float
    instrument: str
    index: int
    recording: str | None = None
    script: str | None = None
    scenario: str | None = None
    pace: float = 1.0
    range_rad: tuple[float, float] | None = None
    core: int | None = None
    priority: int | None = None


def main(task: Task) -> None:
    """Run the drive until the standard input closes."""
    wanted = choose_motion(task)
    told: list[int] = []
    signal.signal(signal.SIGUSR1, lambda number, _frame: told.append(number))  # go on: see `Device.go_on`
    release_scheduling()
    realtime.set_up(task.core, task.priority)
    drive = EmulatedDrive(task.node, task.watchdog_s, Handle(wanted(0.0)))
    bus = canbus.open_bus(task.bus, f"drive node {task.node}")
    began_s = 0.0
    try:
        for tick in ticks(LoopMeter(1.0 / ESTIMATE_S), input_closed):
            now_s = tick.started_ns * 1e-9
            for message in canbus.drain(bus):
                send(bus, drive.receive(message.arbitration_id, bytes(message.data), message.is_remote_frame, now_s))
            began_s = began_s or (now_s if drive.armed_once or told else 0.0)
            send(bus, list(drive.step(wanted(now_s - began_s if began_s else 0.0), now_s, ESTIMATE_S)))
    finally:
        bus.shutdown()


def choose_motion(task: Task) -> hand_motion.Wanted:
    """Return what drives the handle: a recording, a scenario, a script, or a squeeze."""
    wanted = _choose(task)
    return wanted if task.range_rad is None else hand_motion.fitted(wanted, task.range_rad)


def _choose(task: Task) -> hand_motion.Wanted:
    if task.recording is not None:
        return hand_motion.recorded(Path(task.recording))
    if task.scenario is not None:
        return hand_motion.of_scenario(task.scenario, task.index, task.pace)
    if task.script is not None:
        return hand_motion.scripted(task.script, task.instrument, task.pace)
    return hand_motion.squeeze


def send(bus: can.BusABC, frames: list[CanFrame]) -> None:
    """Send the frames of a tick."""
    for identifier, data in frames:
        bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))


def release_scheduling() -> None:
    """Give up core and class of the gateway, which this process was born with."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.sched_setaffinity(0, range(os.cpu_count() or 1))


def input_closed() -> bool:
    """Return whether whoever started this process has closed its standard input, or died."""
    return bool(select.select((sys.stdin,), (), (), 0.0)[0])


if __name__ == "__main__":
    log.set_up("drive_node")
    try:
        main(msgspec.json.decode(sys.argv[1], type=Task))
    except UserError as error:
        print(f"drive_node: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(error.exit_code)
