"""Two arms behind the stand-in of ``libHD.so``: its 1 kHz thread beside the gateway's half of a tick.

    python benchmarks/bench_hdapi.py

Real-time where the system grants it; the loop is paced at 1 kHz, so caches are as cold as in the rig.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from report import Row, Timing, parse, write_report

from tests.gateway.hdapi.hdapi_library import HdapiStandIn
from trocar.protocol.bodies import LocalModel
from trocar.services.gateway.instruments.instrument import Instrument, build_instruments
from trocar.services.runtime.config import config
from trocar.services.runtime.realtime import realtime

TICKS, SETTLE_TICKS, TICK_S = 10_000, 1000, 1e-3
CALLBACK_S, SERVO_S = 100e-6, 50e-6
PRIORITY = 80
STIFFNESS = (30.0, 0.0, 0.0, 0.0, 30.0, 0.0, 0.0, 0.0, 30.0)


def hardware(library: Path) -> list[Instrument]:
    """Return the instruments of the hardware rig, without handles, on the stand-in."""
    settings = config.load_rig("hardware").gateway
    rows = []
    for row in settings.instruments:
        arm = row.arm.model_copy(update={"settings": {**row.arm.settings, "library": str(library)}})
        rows.append(row.model_copy(update={"grasp": None, "arm": arm}))
    return build_instruments(settings.model_copy(update={"instruments": tuple(rows)}))


def tick(instruments: list[Instrument]) -> float:
    """Return the seconds that reading and answering took."""
    sampled_ns = time.monotonic_ns()
    for instrument in instruments:
        at = instrument.state().position_m
        model = LocalModel(stiffness_n_m=STIFFNESS, reference_position_m=at, in_contact=True)
        instrument.servo.accept(np.array(model.row()), 0.02, sampled_ns, 1)
    began = time.perf_counter()
    for instrument in instruments:
        instrument.read(sampled_ns)
    for instrument in instruments:
        instrument.answer(time.monotonic_ns())
    return time.perf_counter() - began


def main() -> None:
    arguments = parse(__doc__, ticks=(TICKS, f"at 1 kHz; the first {SETTLE_TICKS} do not count"))
    realtime.set_up(0, PRIORITY)
    with tempfile.TemporaryDirectory() as folder, HdapiStandIn.compiled(Path(folder), threaded=True) as standin:
        instruments = hardware(standin.path)
        for instrument in instruments:
            instrument.open()
            instrument.warm()
        realtime.freeze_garbage_collector()
        seconds = []
        due = time.monotonic()
        for k in range(arguments.ticks):
            seconds.append(tick(instruments))
            if k == SETTLE_TICKS:
                standin.durations_ns()
            due += TICK_S
            time.sleep(max(0.0, due - time.monotonic()))
        callbacks = 1e-9 * standin.durations_ns()
        states = ", ".join(each.fault or each.servo.engagement.state for each in instruments)
        for instrument in instruments:
            instrument.close()
    servo = Timing.from_samples(np.array(seconds[SETTLE_TICKS:]))
    callback = Timing.from_samples(callbacks)
    rows = [
        Row.from_timing("callback for two arms, law included", callback),
        Row("callback for two arms, 99 %", 1e6 * callback.p99_s, "us", 1e6 * CALLBACK_S),
        Row("callback for two arms, 99.9 %", 1e6 * float(np.percentile(callbacks, 99.9)), "us"),
        Row.from_timing("two arms read and answered by the gateway", servo),
        Row("two arms read and answered, 99 %", 1e6 * servo.p99_s, "us", 1e6 * SERVO_S),
    ]
    write_report(
        "hdapi", "Arms through HDAPI", rows, f"The stand-in of the library; at the end the arms were: {states}."
    )


if __name__ == "__main__":
    main()
