"""Cost of the gateway's tick: arms, servo, handles on their CAN bus, the frame that it publishes.

    python benchmarks/bench_gateway.py

The rig itself is measured by ``trocar up --json``; here each part runs alone, as often as it can.
"""

from __future__ import annotations

import itertools
import time

import numpy as np
from report import Row, measure, parse, write_report

from trocar.protocol import Frame, encode
from trocar.protocol.bodies import GatewayState, LocalModel
from trocar.services.gateway.instruments.instrument import Instrument, build_instruments
from trocar.services.gateway.motions.scene_hands import find_scene_hands
from trocar.services.runtime.config import config

SERVO_S, TICK_S = 100e-6, 1e-3
MODEL = LocalModel(
    force_n=(0.1, 0.0, 0.2),
    stiffness_n_m=(300.0, 0.0, 0.0, 0.0, 300.0, 0.0, 0.0, 0.0, 300.0),
    damping_n_s_m=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    in_contact=True,
)
MODEL_ROW = np.array(MODEL.row())


class Tick:
    """The stub's instruments, ticked by hand."""

    def __init__(self, instruments: list[Instrument]) -> None:
        self.instruments = instruments
        self._ticks = itertools.count(1)

    def servo(self) -> None:
        now_ns = next(self._ticks) * 1_000_000
        for instrument in self.instruments:
            instrument.read(now_ns)
        for instrument in self.instruments:
            instrument.answer(now_ns)

    def accept(self) -> None:
        for instrument in self.instruments:
            instrument.servo.accept(MODEL_ROW, 0.02, 1, 1)

    def state(self) -> GatewayState:
        return GatewayState(tick=1, instruments=tuple(each.state() for each in self.instruments))

    def frame(self) -> bytes:
        return encode(Frame(1, "gateway.state", 1, 1, 1, time.monotonic_ns(), 1, True, self.state()))

    def handles(self) -> None:
        for instrument in self.instruments:
            instrument.exchange_handle()


def main() -> None:
    arguments = parse(__doc__, samples=(5000, "ticks"))
    instruments = build_instruments(config.load_rig("stub").gateway, hands=find_scene_hands("default").hands)
    try:
        for instrument in instruments:
            instrument.open()
            instrument.warm()
        tick = Tick(instruments)
        timings = measure(
            {
                "two arms read, answered and written": tick.servo,
                "two models taken": tick.accept,
                "the device frame made and encoded": tick.frame,
                "two handles on their buses": tick.handles,
            },
            samples=arguments.samples,
        )
    finally:
        for instrument in instruments:
            instrument.close()
    budgets = {"two arms read, answered and written": SERVO_S}
    notes = "The arms are simulated: their links, hands and motors are part of the time. One sample is one tick."
    rows = [Row.from_timing(name, timing, budgets.get(name)) for name, timing in timings.items()]
    write_report("gateway", "Gateway", rows, notes)


if __name__ == "__main__":
    main()
