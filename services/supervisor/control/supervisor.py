"""The supervisor: judges the state of the rig, acts on faults, and publishes the state."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec

import trocar.protocol.bodies as bodies
from trocar.protocol.bodies.supervisor import EVENTS_TOLD, LINE_CHARS
from trocar.protocol.topics import HEALTH_S, JUDGEMENT_S, ORDER_S
from trocar.services.runtime.bus.bus import Bus, new_incarnation
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.private_directory import open_text
from trocar.services.supervisor.control.commands import Commands
from trocar.services.supervisor.crew import hang_detection
from trocar.services.supervisor.crew.crew import Crew, Launch
from trocar.services.supervisor.crew.member import build_members
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.judge import contracts
from trocar.services.supervisor.judge.enforcement import Action, ActionKind, Enforcement, Ladder
from trocar.services.supervisor.judge.governor import Governor, Level
from trocar.services.supervisor.judge.state_machine import RigFacts, RigState, next_state

#: How long the rig must be without faults before it counts as RUNNING (again).
SETTLE_S = 1.0
_JUDGE_S = _TELL_S = HEALTH_S
#: A breach seen for this long, two reports of a process, stands.
_ENTER_S = 0.2


@dataclass(frozen=True, slots=True)
class Setup:
    """Arguments of a supervisor; `safe_stop_file`, if given, keeps a safe stop across its own restart."""

    rig: Rig
    table: tuple[ProcessSpec, ...]
    launch: Launch | None
    levels: tuple[Level, ...] = (Level(),)
    safe_stop_file: Path | None = None


class ShownRecording(Protocol):
    """A recording whose pictures are shown, and that people control."""

    def obey(self, line: str) -> None:
        """Execute a command typed or sent by the page."""

    def status(self) -> bodies.ReplayReport:
        """Return the state of the replay."""


class Supervisor:
    """State of the rig. `step` is called about fifty times a second and never waits."""

    def __init__(
        self, setup: Setup, bus: Bus, now_s: float, on_event: Callable[[bodies.Event], None] | None = None
    ) -> None:
        settings = setup.rig.supervisor
        self.rig = setup.rig
        self.state = RigState.OFF
        self.reason = ""
        self.started_s = now_s
        self.incarnation = new_incarnation()
        self.commands = Commands(self)
        self.page_address = self.next_scenario = self.next_moment = ""
        self.begins_again = False
        self.token_sha256 = ""
        self.start_notice = ""  # what a person should know while it starts
        self.shown: ShownRecording | None = None
        self.meter: LoopMeter | None = None  # measures its own turns
        self.events: deque[bodies.Event] = deque(maxlen=200)
        limits = hang_detection.HangLimits(heartbeat_s=settings.heartbeat_timeout_s, ready_s=settings.ready_timeout_s)
        self.crew = Crew(build_members(setup.rig, setup.table), bus, limits, setup.launch, self.say)
        patience_s = contracts.STILL_S + 2.0 * SETTLE_S  # outlasts a stall's effect on windows and hysteresis
        ladder = Ladder(levels=setup.levels, patience_s=patience_s, may_restart=setup.launch is not None)
        self.enforcement = Enforcement(ladder)
        self.breaches: list[contracts.Breach] = []
        self._stalled: list[contracts.Breach] = []
        self._bus = bus
        self._on_event = on_event
        self._standing = contracts.Standing(_ENTER_S, SETTLE_S)
        self._safe_stop_file = setup.safe_stop_file
        self._safe_stop = self._remembered()
        self._armed, self._armed_s = 0, float("-inf")
        self._orders: deque[tuple[bodies.Order, float, float]] = deque(maxlen=8)
        self._attempt_answers: tuple[bodies.Answer, ...] = ()
        self._now_s = now_s
        self._not_ready_s = self._trouble_s = now_s
        self._judged_s = self._told_s = self._judgement_told_s = float("-inf")
        self._told: bodies.SupervisorState | None = None
        self._up: set[str] = set()

    def arm(self, who: str) -> None:
        """End a safe stop, and retry whatever has a fault; `who` requested it."""
        self.say("info", f"supervisor: armed by {who}")
        self._armed, self._armed_s = self._armed + 1, self._now_s
        self._safe_stop = ""
        if self._safe_stop_file is not None:
            self._safe_stop_file.unlink(missing_ok=True)
        self.crew.rearm(self._now_s)
        self.enforcement.reset()

    def safe_stop(self, who: str) -> None:
        """Stop the rig safely; `who` requested it."""
        self._stop_safely(f"commanded by {who}")

    def order(self, order: bodies.Order, before_s: float, who: str) -> None:
        """Pass on an order for the attempt, until `before_s` of the rig's time."""
        self.say("info", f"supervisor: attempt: {order.what} asked for by {who}")
        self._orders.append((order, self._now_s, self.started_s + before_s))

    def attempt_answers(self) -> tuple[bodies.Answer, ...]:
        """Return the training process' last answers."""
        if (frame := self._bus.latest("training.attempt")) is not None:
            self._attempt_answers = frame.body.answers
        return self._attempt_answers

    def switch(self, scenario: str, who: str) -> None:
        """Request the end of this session and a new one with another scenario; `who` requested it."""
        self.say("info", f"supervisor: scenario {scenario} asked for by {who}")
        self.next_scenario = scenario

    def take_over(self, moment: str, who: str) -> None:
        """Request the end of this session and one that goes on from a recording's tick; `who` requested it."""
        self.say("info", f"supervisor: to go on from {moment} is asked for by {who}")
        self.next_moment, self.begins_again = moment, True

    def restart(self, who: str) -> None:
        """Request the end of this session and a new one with what its files say by then; `who` requested it."""
        self.say("info", f"supervisor: a new start asked for by {who}")
        self.begins_again = True

    def step(self, now_s: float) -> None:
        """Take one turn at `now_s` of the monotonic clock."""
        self._now_s = now_s
        self.crew.step(now_s)
        if self.crew.fatal is not None:
            return
        self._restart_judgement_after_start()
        if now_s - self._judged_s >= _JUDGE_S:
            self._judged_s = now_s
            self._judge()
        self._move()
        self._tell()
        self.commands.answer_finished(now_s)

    def stop_step(self, now_s: float) -> bool:
        """Take one turn of ending the rig; return whether all child processes have ended."""
        self._now_s = now_s
        self._enter(RigState.OFF, "the rig is asked to end")
        self._tell()
        return self.crew.stop_step(now_s)

    def say(self, level: str, text: str) -> None:
        """Add an event; "debug" ones are passed on but not stored."""
        event = bodies.Event(round(self._now_s - self.started_s, 3), level, text[:LINE_CHARS])
        if level != "debug":
            self.events.append(event)
        if self._on_event is not None:
            self._on_event(event)

    def body(self) -> bodies.SupervisorState:
        """Return the published state."""
        ending = self.state is RigState.OFF and self.crew.stopping and self.crew.launch is not None
        return bodies.SupervisorState(
            state=self.state,
            quality_level=self.enforcement.level,
            safe_stop=bool(self._safe_stop) or ending,
            reason=self.reason[:512],
            processes=tuple(member.body() for member in self.crew.members.values()),
            token_sha256=self.token_sha256,
            quality=_quality(self.enforcement.governor),
            armed=self._armed,
            orders=tuple(
                msgspec.structs.replace(order, age_s=max(self._now_s - said_s, 0.0))
                for order, said_s, until_s in self._orders
                if self._now_s < min(said_s + ORDER_S, until_s)
            ),
        )

    def judgement(self) -> bodies.Judgement:
        """Return what is published for people."""
        members = self.crew.members.items()
        progress = {name: each.progress for name, each in members if each.progress is not None and not each.came_up}
        return bodies.Judgement(
            incarnation=self.incarnation,
            t=round(self._now_s - self.started_s, 3),
            broken=tuple(breach.key for breach in self.breaches),
            path_limits_us=self.path_limits_us(),
            events=tuple(self.events)[-EVENTS_TOLD:],
            start_notice=self.start_notice[:LINE_CHARS] if self.state is RigState.STARTING else "",
            starts=tuple(
                bodies.StartReport(process=name, stage=stage, fraction=fraction)
                for name, (stage, fraction) in progress.items()
            ),
            replay=None if self.shown is None else self.shown.status(),
        )

    def _stop_safely(self, reason: str) -> None:
        if self._safe_stop:
            return
        self._safe_stop = reason
        if self._safe_stop_file is not None:
            with open_text(self._safe_stop_file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC) as file:
                file.write(reason)
        self.say("error", f"supervisor: safe stop: {reason}")

    def _remembered(self) -> str:
        if self._safe_stop_file is None:
            return ""
        try:
            with open_text(self._safe_stop_file) as file:
                return file.read()
        except FileNotFoundError:
            return ""

    def _restart_judgement_after_start(self) -> None:
        up = {name for name, member in self.crew.members.items() if member.up}
        if up - self._up:  # its start has disturbed the others as well
            self._restart_judgement()
        self._up = up

    def _restart_judgement(self) -> None:
        for member in self.crew.members.values():
            member.window.forget_reports()
        self._standing.clear()

    def _judge(self) -> None:
        # A process after one that is down cannot keep its rate, and is not at fault. It counts its losses when the
        # first tick arrives again, and reports them after that.
        if not self.crew.all_ready or self._now_s - self._not_ready_s < SETTLE_S:
            self._restart_judgement()
        seen = []
        windows = {name: member.window for name, member in self.crew.members.items() if member.up}
        if self.state in (RigState.RUNNING, RigState.DEGRADED):
            seen = contracts.judge(windows, self.rig.contracts)
        self._stalled = self._stalls()
        self.breaches = [*self._standing.update(self._now_s, seen), *self._stalled]
        standing = [breach for breach in self.breaches if self._is_critical(breach.process)]
        spent_s = contracts.spent_s(windows, self.rig.contracts, standing) if standing else 0.0
        action = self.enforcement.decide(self._now_s, standing, spent_s)
        if action is not None:
            self._act(action)

    def path_limits_us(self) -> dict[str, float]:
        """Return the present limit of each path."""
        windows = {name: member.window for name, member in self.crew.members.items()}
        return contracts.path_limits_us(windows, self.rig.contracts)

    def _stalls(self) -> list[contracts.Breach]:
        """Return breaches of processes with repeated silences, a reason to lower the quality, not to stop."""
        said = {name: hang_detection.stalling(member, self._now_s) for name, member in self.crew.members.items()}
        return [
            contracts.Breach(name, f"{name} stalls", text, 1.0, severe=False) for name, text in said.items() if text
        ]

    def _is_critical(self, name: str) -> bool:
        member = self.crew.members.get(name)
        return member is not None and member.critical

    def _act(self, action: Action) -> None:
        level = "info" if action.kind is ActionKind.RAISE else "warning"
        self.say(level, f"supervisor: {action.kind.value} {action.process}: {action.reason}".replace(" : ", ": "))
        if action.kind is ActionKind.RESTART:
            self.crew.restart(action.process, action.reason)
        elif action.kind is ActionKind.SAFE_STOP:
            self._stop_safely(action.reason)
        self._restart_judgement()
        for member in self.crew.members.values():
            member.stalls_s.clear()

    def _move(self) -> None:
        now_s = self._now_s
        gateway = self.crew.members.get("gateway")
        if gateway is not None and gateway.safe_stop_said(self._armed_s) == 2.0:
            self._stop_safely("asked of the gateway itself")
        failed = [m for m in self.crew.members.values() if m.critical and m.state == "failed"]
        if failed:
            self._stop_safely(failed[0].reason)
        breaches = sorted(self.breaches, key=lambda breach: not self._is_critical(breach.process))
        troubles = [*self.crew.troubles(), *(breach.text for breach in breaches)]
        if not self.crew.all_ready:
            self._not_ready_s = now_s
        if troubles:
            self._trouble_s = now_s
        situation = RigFacts(
            all_ready=self.crew.all_ready,
            trouble=bool(troubles),
            settled=now_s - self._not_ready_s >= SETTLE_S,
            calm=now_s - self._trouble_s >= SETTLE_S,
            safe_stop=bool(self._safe_stop),
            stalling=self.crew.all_came_up and bool(self._stalled),
        )
        reason = self._safe_stop or (troubles[0] if troubles else "")
        self._enter(next_state(self.state, situation), reason)

    def _enter(self, state: RigState, reason: str) -> None:
        self.reason = "" if state in (RigState.RUNNING, RigState.READY) else reason or self.reason
        if state is not self.state:
            self.state = state
            level = "warning" if state in (RigState.DEGRADED, RigState.SAFE_STOP) else "info"
            self.say(level, f"supervisor: {state}{': ' if self.reason else ''}{self.reason}")

    def _tell(self) -> None:
        body = self.body()
        # The reason contains figures that change all the time; ten updates a second are enough for them.
        changed = self._told is None or _gist(body) != _gist(self._told)
        if changed or self._now_s - self._told_s >= _TELL_S:
            self._told, self._told_s = body, self._now_s
            self._bus.publish("supervisor.state", body)
        if self._now_s - self._judgement_told_s >= JUDGEMENT_S:
            self._judgement_told_s = self._now_s
            self._bus.publish("supervisor.judgement", self.judgement())


def _quality(governor: Governor) -> bodies.QualityReport:
    rung = governor.rung
    return bodies.QualityReport(
        name=rung.name,
        rungs=len(governor.levels),
        cost_us=rung.cost_us,
        force_error_percent=rung.force_error_percent,
        motion_error_percent=rung.motion_error_percent,
        lowered=governor.lowered,
        raised=governor.raised,
    )


def _gist(body: bodies.SupervisorState) -> tuple[object, ...]:
    processes = tuple((p.name, p.state, p.pid, p.restarts) for p in body.processes)
    orders = tuple(order.id for order in body.orders)
    return body.state, body.quality_level, body.safe_stop, body.armed, orders, processes
