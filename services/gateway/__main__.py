"""The gateway: devices at 1 kHz, and the servo between them and the newest contact model.

A tick has two halves. At its deadline the arms are read, answered and published, because the force on the hand comes
first. The handles, whose drives are on a slow bus, are served once haptics has had time to answer, from the newest
model then; a later model is used at the next deadline. If it is late, haptics needs the core: handles then wait for the
next tick, within a limit. Nothing wakes the gateway in between, as haptics runs on the same core, except for the models
that are waited for to measure their latency (`TIMED_EVERY`).
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process
from trocar.protocol.topics import MOMENT_TICKS, TICK_HZ

# isort: split
import sys
import time

from trocar.protocol.bodies import GatewayState
from trocar.services.gateway.instruments.handle_schedule import HandleSchedule
from trocar.services.gateway.instruments.instrument import Instrument, build_instruments
from trocar.services.gateway.instruments.model_intake import ModelIntake
from trocar.services.gateway.motions import scene_hands
from trocar.services.gateway.motions.scene_hands import SceneHands
from trocar.services.gateway.newest_frames import NewestFrames
from trocar.services.gateway.orders.attempt_orders import AttemptOrders
from trocar.services.gateway.orders.rig_time import RigTime
from trocar.services.gateway.orders.supervisor_commands import SupervisorCommands
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.bus.stop_line import StopLine
from trocar.services.runtime.config.rig import ReplaySettings
from trocar.services.runtime.log import progress
from trocar.services.runtime.loop.loop import LoopMeter, Tick, sleep_until, ticks
from trocar.services.runtime.loop.simulated_speed import SpeedGovernor
from trocar.services.runtime.process.health import LatencyPath
from trocar.services.runtime.process.process import Process, ProcessConfig, main

MODEL = "haptics.contact_model"
ATTEMPT = "training.attempt"
HANDS = "visualization.hands"
RATE_HZ = TICK_HZ
#: Rate while the rig starts and no arm bears a force, so that the loops leave time for processes that are not ready.
#: All streams still count as fresh.
STARTING_HZ = 250.0
STAGES = ("take", "servo", "send")
#: Ticks between checks of devices and processes: two in each report of this process, as nobody learns of more.
_LOOK_ROUND_EVERY = 50
#: Checks in a row, of two seconds, with mostly invalid models before that is reported, as a restart of haptics takes
#: less.
_INVALID_LOOKS = 40
#: A part of a report is made this long before the handles are served, and mostly takes less. A whole report, 300 to
#: 420 us with cold caches, would delay ten ticks a second.
_REPORT_NS = 150_000
#: The handles are served this long before the next tick: twice their p99.9 duration, and when haptics, which shares the
#: core, is nearly always done. Earlier they would interrupt it just when it is late.
_HANDLES_NS = 250_000
#: Batches for observers are sent after the handles if this much time is left before the next tick; one takes 90 us.
_BATCH_NS = 120_000
#: Ticks between those in which the model is waited for, to measure its arrival (`device_model`). The wake-up interrupts
#: haptics, so it is not done in every tick, and only the time is taken; the supervisor's window has a hundred of them.
TIMED_EVERY = 16
#: Ticks between polls for orders, which come ten times a second; a poll takes 10 us.
_ORDERS_EVERY = 4
#: The same for orders of an attempt, for which only a person waits.
_ATTEMPT_EVERY = 16
#: Rate at which simulated time catches up with the clock: the most that it may be behind, 50 ms, takes a fifth of a
#: second.
CATCH_UP_HZ = 1250.0
#: Ticks of the loop after which an unanswered tick is sent again, as somebody may have begun anew.
_AGAIN_EVERY = 8
#: Most frames examined while waiting for an answer, so that a flooding publisher cannot take this core.
_LOOKS = 4


class Gateway:
    """The instruments of a rig and their messages to other processes."""

    def __init__(self, process: Process, hands: SceneHands) -> None:
        self._process = process
        self._bus, self._health = process.bus, process.health
        self.meter = LoopMeter(RATE_HZ, STAGES)
        self._newest = NewestFrames(self._bus)
        self.instruments = build_instruments(process.rig.gateway, self._newest, hands.hands)
        servos = [each.servo for each in self.instruments]
        self._others = [(each, [servo for servo in servos if servo is not each.servo]) for each in self.instruments]
        self._servo = self._path("servo", 100.0)
        self._grasp = self._path("grasp", 300.0)
        self._answers = ModelIntake(
            self.instruments, self._path("device_model", 800.0), self._path("device_force", 2000.0)
        )
        self.orders = SupervisorCommands(self.instruments, process.rig.gateway.supervisor_timeout_s)
        self._time = RigTime(self.meter.period_ns, simulated=process.rig.simulated_time)
        self._speed = SpeedGovernor() if self._time.simulated and process.rig.page_hands() else None
        self._unanswered = 0
        self._attempt = AttemptOrders(self.instruments, self._time)
        self._turns = HandleSchedule(len(self.instruments))
        self._look_round = self._timed = False
        # Of the last tick: index, when sampled by the clock and for the servos, when written.
        self._unsettled: tuple[int, int, int, int] | None = None

    def _path(self, name: str, default_us: float) -> LatencyPath:
        contract = self._process.rig.contracts.paths.get(name)
        return self._health.path(name, round(1e3 * (contract.p99_us if contract else default_us)))

    def begin_at(self, tick: int) -> None:
        """Start the rig's time at `tick`, the end of a replay."""
        self._time.index = tick - 1

    def open(self) -> None:
        """Open every device, then run every kernel once."""
        for number, instrument in enumerate(self.instruments):
            progress(f"opening {instrument.name}", number / len(self.instruments))
            instrument.open()
            instrument.warm()
        progress("devices open", 1.0)

    def tick(self, tick: Tick) -> None:
        """Read, answer, write and publish; all other work comes later, as haptics waits for this core."""
        take_model(self._bus, self._answers)
        is_answered = not self._answers.is_unheard
        self._time.advance(tick.index, tick.scheduled_ns, is_answered=is_answered)
        if self._time.simulated:
            self.meter.change_rate(self._rate_hz())
            self._unanswered = 0 if is_answered else self._unanswered + 1
            if self._unanswered % _AGAIN_EVERY:
                self._take_orders(tick.index)
                return
        self._attempt.execute_orders()
        self.meter.tick = self._time.index
        sampled_ns = time.monotonic_ns()
        posed_ns = self._time.time_ns if self._time.simulated else sampled_ns
        if not (self._time.simulated and self._time.stands):
            self._follow_hands(posed_ns)
        written_ns = time.monotonic_ns()
        state = GatewayState(
            tick=self._time.index,
            instruments=tuple(each.state() for each in self.instruments),
            begins=self._attempt.begins,
            withdrawn=sum(each.is_withdrawn << number for number, each in enumerate(self.instruments)),
        )
        self._bus.publish("gateway.state", state, origin_ns=sampled_ns)
        if self._time.simulated and not self._time.stands and self._time.index % MOMENT_TICKS == 0:
            self._bus.publish("gateway.moment", state, origin_ns=sampled_ns)
        self.meter.stages_ns = (
            sampled_ns - tick.started_ns, written_ns - sampled_ns, time.monotonic_ns() - written_ns
        )  # fmt: skip
        self._unsettled = tick.index, sampled_ns, posed_ns, written_ns
        self._timed = tick.index % TIMED_EVERY == 0
        self._look_round = tick.index % _LOOK_ROUND_EVERY == 0

    def _follow_hands(self, now_ns: int) -> None:
        """Read every arm, answer it with a force, and serve a handle where that has to come in each tick."""
        for instrument in self.instruments:
            instrument.read(self._time.time_ns)
        turn = self._turns.next(late=False) if self._time.simulated else None
        if turn is not None:
            self.instruments[turn].exchange_handle(now_ns)
        for instrument, others in self._others:
            instrument.answer_pose(now_ns, others)

    def _settle_tick(self) -> None:
        """Account for the last tick and poll for orders, once, before its answer is used."""
        if self._unsettled is None:
            return
        index, sampled_ns, posed_ns, written_ns = self._unsettled
        self._unsettled = None
        self._servo.latency.record(written_ns - sampled_ns)
        self._answers.applied(written_ns)
        self._answers.expect_answer(self._time.index, sampled_ns, timed=self._timed, posed_ns=posed_ns)
        self._take_orders(index)

    def _take_orders(self, index: int) -> None:
        """Poll for orders of the supervisor, and for those of the attempt."""
        if index % _ORDERS_EVERY == 0:
            said = self._bus.drain("supervisor.state")
            self.orders.obey_frames(said, time.monotonic_ns())
            if said:
                self._attempt.starting = said[-1].body.state == "starting"
                self.meter.change_rate(self._rate_hz())
        if index % _ATTEMPT_EVERY == 0:
            self._attempt.obey_frame(self._bus.latest(ATTEMPT), self._bus.is_fresh(ATTEMPT))
            if self._speed is not None:
                self._time.speed = self._speed_for_pictures(self._speed)

    def _speed_for_pictures(self, governor: SpeedGovernor) -> float:
        """Return the speed of simulated time at which the page that has the hands shows enough pictures."""
        frame = self._newest(HANDS)
        if frame is not None and frame.valid:
            attempt = self._bus.latest(ATTEMPT)
            is_played = attempt is None or attempt.body.state == "running"
            governor.take_pictures(frame.sent_ns * 1e-9, frame.body.pictures_hz, is_played=is_played)
        governor.forget_silent_page(time.monotonic())
        return governor.speed

    def serve(self, deadline_ns: int) -> None:
        """Serve the handles until `deadline_ns`, from the model that answers the last tick."""
        handles_ns = deadline_ns - _HANDLES_NS
        came_ns = 0
        if self._timed:
            self._settle_tick()
            came_ns = notice(self._bus, self._answers, handles_ns)
        if self._look_round or self._health.is_due():
            sleep_until(handles_ns - _REPORT_NS)
            self._settle_tick()
            self._report()
        sleep_until(handles_ns)  # leaves the core to haptics
        self._settle_tick()
        take_model(self._bus, self._answers, came_ns)
        began_ns = time.monotonic_ns()
        turn = None if self._time.simulated else self._turns.next(late=self._answers.outstanding)
        if turn is not None:  # one handle a tick, each of two at 500 Hz: docs/decisions/handles-take-turns.md
            self.instruments[turn].exchange_handle()
            self._grasp.latency.record(time.monotonic_ns() - began_ns)
        if deadline_ns - time.monotonic_ns() >= _BATCH_NS:
            self._bus.flush()
        if self._answers.timed:
            listen(self._bus, self._answers, deadline_ns)
        sleep_until(deadline_ns)

    def _rate_hz(self) -> float:
        """Return the rate of the loop: slow during the start, fast while simulated time has to catch up."""
        if self._attempt.starting:
            return STARTING_HZ
        return self._time.speed * (CATCH_UP_HZ if self._time.is_behind else RATE_HZ)

    def ended(self) -> bool:
        """Return whether the process was told to end and no hand bears a force any more."""
        return self._process.stop() and let_go(self.instruments)

    def _report(self) -> None:
        """Sample the instruments for a report, or make a part of one that is due."""
        if not self._look_round:
            self._health.do_a_piece()
            return
        gauges = self._health.gauges
        for each in self.instruments:
            gauges[f"{each.name}.energy_j"] = each.servo.energy_j
            gauges[f"{each.name}.not_finite"] = float(each.servo.refused)
            gauges.update(each.links())
        gauges.update({f"models_{reason}": float(count) for reason, count in self._answers.refused.items()})
        gauges["safe_stop"] = self.orders.stop_report
        silent = ["the supervisor is silent: every hand is let go"] if self.orders.unsupervised else []
        if self._answers.invalid_looks() >= _INVALID_LOOKS:
            silent.append("no force: what haptics hears of physics is too old, or nothing")
        faults = "; ".join(silent + [f"{each.name}: {each.fault}" for each in self.instruments if each.fault])
        self._health.change("degraded" if faults else "running", faults)

    def close(self) -> None:
        """Leave zero force on every device."""
        for instrument in self.instruments:
            instrument.close()
        if self.orders.line is not None:
            self.orders.line.close()


def take_model(bus: Bus, answers: ModelIntake, came_ns: int = 0) -> None:
    """Pass the answer to the last tick to the servos, if it is new; it arrived now, or at `came_ns`."""
    frame = bus.latest(MODEL) if answers.outstanding else None
    if frame is not None:
        answers.accept(frame, came_ns or time.monotonic_ns())


def notice(bus: Bus, answers: ModelIntake, until_ns: int) -> int:
    """Wait for a model until `until_ns`, without interrupting haptics; return its time of arrival, 0 for none."""
    return time.monotonic_ns() if answers.outstanding and bus.wait(MODEL, until_ns) else 0


def listen(bus: Bus, answers: ModelIntake, until_ns: int) -> None:
    """Wait for the answer to the last tick until `until_ns`."""
    for _ in range(_LOOKS):
        if not answers.outstanding or not bus.wait(MODEL, until_ns):
            return
        take_model(bus, answers)


def let_go(instruments: list[Instrument]) -> bool:
    """Reduce all forces to zero at the rate limit; return whether no force is left."""
    for instrument in instruments:
        instrument.servo.engagement.stop()
    return all(instrument.servo.limp for instrument in instruments)


def prepare(process_config: ProcessConfig) -> SceneHands:
    """Find the motions of hands in the scene, if a device follows them; compile the kernels of a tick if none does."""
    gateway, hands = process_config.rig.gateway, SceneHands()
    if scene_hands.are_called_for(gateway):
        hands = scene_hands.find_scene_hands(process_config.scene_name, process_config.scene_overrides)
    if process_config.prepare_only:
        _rehearse(build_instruments(gateway, hands=hands.hands))
    return hands


def _rehearse(instruments: list[Instrument]) -> None:
    """Open every device and compile the kernels of a tick."""
    try:
        for instrument in instruments:
            instrument.open()
            instrument.warm()
    finally:
        for instrument in instruments:
            instrument.close()


def _replay(process: Process, settings: ReplaySettings, meter: LoopMeter) -> int:
    """Replay a recording; return the tick at which hands continue."""
    from trocar.services.gateway.replaying import Replay  # readers of recordings are not installed with every gateway

    replay = Replay(process, settings, meter)
    process.ready(meter)
    replay.run()
    return replay.next_tick


def run(process: Process, hands: SceneHands) -> None:
    """Tick until the process is told to end."""
    gateway, settings = Gateway(process, hands), process.rig.replay
    try:
        gateway.orders.line = StopLine(process.rig.transport)
        if settings is None or settings.take_over:
            gateway.open()
        first = 0 if settings is None else _replay(process, settings, gateway.meter)
        if first == 0:
            process.ready(gateway.meter)
        gateway.begin_at(first)
        for tick in ticks(gateway.meter, gateway.ended, gateway.serve, first):
            gateway.tick(tick)
    finally:
        gateway.close()


if __name__ == "__main__":
    sys.exit(main("gateway", run, prepare=prepare))
