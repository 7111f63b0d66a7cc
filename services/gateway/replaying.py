"""The gateway in a replay: recorded device frames instead of devices, each sent once the last one was answered."""

from __future__ import annotations

import time

from trocar.protocol.topics import TICK_NS, TICK_S
from trocar.services.recordings.inputs import Intake, read_inputs
from trocar.services.recordings.schedule import ASK_AGAIN_NS, replayed
from trocar.services.runtime.config.rig import ReplaySettings
from trocar.services.runtime.loop.loop import LoopMeter, sleep_until
from trocar.services.runtime.process.process import Process

_MODEL = "haptics.contact_model"
_HOLD_NS = 20 * TICK_NS  # a fifth of the time between two reports, as nothing else is left to do


class Replay:
    """Publishes recorded device frames.

    Attributes:
        next_tick: Next tick of the rig's clock after the replayed ones.
    """

    def __init__(self, process: Process, settings: ReplaySettings, meter: LoopMeter) -> None:
        self._process, self._settings, self._meter = process, settings, meter
        self._intakes = replayed(read_inputs(settings.file), settings.until_s)
        self._first = self._intakes[0].tick
        self.next_tick = self._intakes[-1].tick + 1

    def run(self) -> None:
        """Replay once or repeatedly; return when hands take over or the process is told to end."""
        while not self._process.stop():
            self._replay()
            if not self._settings.loop:
                break
        self._process.health.gauges["replayed"] = 1.0
        while not (self._process.stop() or self._settings.take_over):
            self._process.health.send_if_due()
            sleep_until(time.monotonic_ns() + _HOLD_NS)

    def _replay(self) -> None:
        """Publish each frame at its time, and those before `from_s` as fast as they are answered."""
        begin = self._first + round(self._settings.from_s / TICK_S)
        began_ns = time.monotonic_ns()
        for intake in self._intakes:
            if self._process.stop():
                return
            due_ns = time.monotonic_ns()
            if intake.tick <= begin:
                began_ns = due_ns
            elif self._settings.rate > 0.0:
                due_ns = began_ns + round((intake.tick - begin) * 1e9 * TICK_S / self._settings.rate)
            sleep_until(due_ns)
            self._meter.start(due_ns, time.monotonic_ns())
            self._meter.tick = intake.tick
            self._ask_haptics(intake)
            self._meter.finish(time.monotonic_ns())
            self._do_side_work()

    def _ask_haptics(self, intake: Intake) -> None:
        """Publish a frame until haptics has answered it."""
        bus = self._process.bus
        while not self._process.stop():
            bus.publish("gateway.state", intake.devices.body, origin_ns=time.monotonic_ns())
            ask_again_ns = time.monotonic_ns() + ASK_AGAIN_NS
            while bus.wait(_MODEL, ask_again_ns):
                model = bus.latest(_MODEL)
                if model is not None and model.body.tick == intake.tick:
                    return
            self._do_side_work()

    def _do_side_work(self) -> None:
        self._process.bus.flush()
        self._process.bus.drain("supervisor.state")
        self._process.health.do_a_piece()
