"""The gateway: devices at 1 kHz, and the servo between them and the newest contact model.

A tick has two halves. At its deadline the arms are read, answered and published: nothing comes before what the hand
feels. The handles, whose drives are on a bus that takes its time, are served while haptics works on the answer, or
right after it has come.
"""

from __future__ import annotations

import sys
import time
from functools import partial

from protocol.bodies import GatewayState
from services.gateway.answers import Answers
from services.gateway.instrument import Instrument, build_instruments
from services.gateway.orders import Orders
from services.runtime.health import Path
from services.runtime.log import progress
from services.runtime.loop import LoopMeter, sleep_until, ticks
from services.runtime.process import Process, main

MODEL = "haptics.contact_model"
RATE_HZ = 1000.0
_GAUGES_EVERY = 50
#: The handles are served at the latest this long before the next tick.
_HANDLES_NS = 400_000


def run(process: Process) -> None:
    """Tick until asked to end: read, answer, write, publish; then listen for the model until the next tick."""
    bus, health = process.bus, process.health
    instruments = build_instruments(process.rig.gateway)
    servo = contract_path(process, "servo", 100.0)
    answers = Answers(
        instruments, contract_path(process, "device_model", 800.0), contract_path(process, "device_force", 2000.0)
    )
    grasp = contract_path(process, "grasp", 300.0)
    orders = Orders(instruments)
    meter = LoopMeter(RATE_HZ)
    try:
        open_devices(instruments)
        process.ready(meter)
        for tick in ticks(meter, process.stop, partial(serve, process, instruments, answers, grasp)):
            sampled_ns = time.monotonic_ns()
            for instrument in instruments:
                instrument.read(tick.scheduled_ns)
            for instrument in instruments:
                instrument.answer(sampled_ns)
            written_ns = time.monotonic_ns()
            state = GatewayState(tick=tick.index, instruments=tuple(i.state() for i in instruments))
            bus.publish("gateway.state", state, origin_ns=sampled_ns)
            servo.latency.record(written_ns - sampled_ns)
            answers.applied(written_ns)
            answers.ask(tick.index, sampled_ns)
            orders.obey(bus.drain("supervisor.state"))
            if tick.index % _GAUGES_EVERY == 0:
                report(process, instruments, answers)
            health.send_if_due()
    finally:
        for instrument in instruments:
            instrument.close()


def serve(process: Process, instruments: list[Instrument], answers: Answers, grasp: Path, deadline_ns: int) -> None:
    """Until `deadline_ns`: take the model that answers the last tick when it arrives, and serve the handles."""
    listen(process, answers, deadline_ns - _HANDLES_NS)
    began_ns = time.monotonic_ns()
    for instrument in instruments:
        instrument.exchange_handle()
    grasp.latency.record(time.monotonic_ns() - began_ns)
    listen(process, answers, deadline_ns)
    sleep_until(deadline_ns)


def listen(process: Process, answers: Answers, until_ns: int) -> None:
    """Wait for the answer to the last tick, at most until `until_ns`."""
    bus = process.bus
    while answers.outstanding and time.monotonic_ns() < until_ns and bus.wait(MODEL, until_ns):
        frame = bus.latest(MODEL)
        if frame is not None:
            answers.accept(frame, time.monotonic_ns())


def contract_path(process: Process, name: str, default_us: float) -> Path:
    """Return a reported path whose histogram has its contract's limit as an edge."""
    contract = process.rig.contracts.paths.get(name)
    return process.health.path(name, round(1e3 * (contract.p99_us if contract else default_us)))


def open_devices(instruments: list[Instrument]) -> None:
    """Open every device, then run every kernel once."""
    for number, instrument in enumerate(instruments):
        progress(f"opening {instrument.name}", number / len(instruments))
        instrument.open()
        instrument.warm()
    progress("devices open", 1.0)


def report(process: Process, instruments: list[Instrument], answers: Answers) -> None:
    """Put what is worth a line on the dashboard into the health report."""
    health = process.health
    for instrument in instruments:
        servo = instrument.servo
        health.gauges[f"{instrument.name}.energy_j"] = servo.energy_j
        health.gauges[f"{instrument.name}.not_finite"] = float(servo.refused)
    for reason, count in answers.refused.items():
        health.gauges[f"models_{reason}"] = float(count)
    faults = "; ".join(f"{i.name}: {i.fault}" for i in instruments if i.fault)
    health.change("degraded" if faults else "running", faults)


if __name__ == "__main__":
    sys.exit(main("gateway", run))
