"""All processes of the rig: they are started in order, heard, watched, restarted, and ended in order."""

from __future__ import annotations

import os
import select
import signal
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import trocar.protocol.bodies as bodies
from trocar.protocol.topics import TICK_NS
from trocar.services.recordings.errors import HoleError, RecordingError
from trocar.services.runtime import log
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.errors import EndOfRig
from trocar.services.supervisor.crew import hang_detection
from trocar.services.supervisor.crew.exit_messages import how_it_ended, level_of, start_sentence
from trocar.services.supervisor.crew.floods import Floods
from trocar.services.supervisor.crew.fork_link import ForkServer
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.crew.loop_progress import LoopProgress
from trocar.services.supervisor.crew.member import SAY_AGAIN_S, Fault, Member, MemberState

#: How long a process may take to end by itself.
END_S = 5.0
#: A turn of the supervisor later than this was delayed, and the time does not count against any process.
_HELD_UP_S = 0.05
#: A lost process is noticed within this time, unless the supervisor itself is delayed, which it then reports: after the
#: 60 ms of silence that are a hang (`hang_detection.STREAM_SILENCE_S`) it has time for two turns of 20 ms.
_NOTICE_S = 0.1
#: This process ends last: it controls the arms, and removes forces by itself when the others fall silent.
_LAST = "gateway"
#: Time of listening to a 1 kHz stream in one turn: ten periods, so that a frame comes in nearly every turn, and half a
#: turn.
PATIENCE_NS = 10 * TICK_NS


@dataclass(frozen=True, slots=True)
class Launch:
    """How processes are started: command line, directory of logs, and optionally a fork server."""

    arguments: tuple[str, ...]
    log_directory: Path
    fork_server: ForkServer | None = None


@dataclass(slots=True)
class Crew:
    """The processes; with `launch` None they are run by others and only watched."""

    members: dict[str, Member]
    bus: Bus
    limits: hang_detection.HangLimits
    launch: Launch | None
    say: Callable[[str, str], None]
    on_report: Callable[[str, bodies.Health], None] = lambda _name, _health: None
    loop_progress: LoopProgress = field(default_factory=lambda: LoopProgress(None))
    has_heard_all: Callable[[], bool] = lambda: True
    fatal: Fault | None = None  # of a process that could not even start, so that a retry is useless
    ended_by_person: bool = False
    stopping: bool = False
    _last_step_s: float | None = None
    _heard_all_s: float = 0.0
    _held_up_s: float = 0.0
    _said_held_up_s: float = float("-inf")
    _was_ready: set[str] = field(default_factory=set)
    _prepared: set[str] = field(default_factory=set)
    _floods: Floods = field(default_factory=Floods)

    def step(self, now_s: float) -> None:
        """Hear all processes, notice those that ended or hang, and start those that are due."""
        self._forgive_own_delay(now_s)
        hearing = self._is_hearing(now_s)  # before reading: later messages are heard in the next turn
        flowing = self._flowing()
        self._warn(self._floods.messages("supervisor", os.getpid(), self.bus.floods(), now_s))
        if self.launch is not None and self.launch.fork_server is not None and not self.stopping:
            self._warn(self.launch.fork_server.tend_server())
        for member in self.members.values():
            flows = member.name in flowing
            self._hear(member, now_s, flows)
            if member.child is not None:
                self._read_lines(member, now_s)
                status = member.child.end()
                if status is not None:
                    self._ended(member, status, now_s)
                    continue
            if not self.stopping:
                self._watch(member, now_s, hearing, flows)
                self._start_if_due(member, now_s)

    def wait(self, timeout_s: float) -> None:
        """Sleep until a child process ends, the fork server answers, or `timeout_s` has passed."""
        poll = select.poll()
        server = self.launch.fork_server if self.launch is not None else None
        if server is not None and not self.stopping and (descriptor := server.descriptor) is not None:
            poll.register(descriptor, select.POLLIN)
        for member in self.members.values():
            if member.child is not None:
                poll.register(member.child.descriptor, select.POLLIN)
        poll.poll(timeout_s * 1e3)

    @property
    def all_ready(self) -> bool:
        """Whether every process is up, except for non-critical ones that were given up."""
        return all(m.up for m in self._awaited())

    @property
    def all_came_up(self) -> bool:
        """Whether every process has been up since it was started, regardless of its present state."""
        return all(m.came_up for m in self._awaited())

    def _awaited(self) -> list[Member]:
        """Return all processes except non-critical ones that were given up."""
        return [m for m in self.members.values() if m.critical or m.state is not MemberState.FAILED]

    def has_ended(self, member: Member) -> bool:
        """Return whether a process is known not to run, as our child; one that others run may only be silent."""
        return self.launch is not None and member.child is None

    def troubles(self) -> list[str]:
        """Return a sentence on each process that should be up and is not, critical ones first."""
        members = sorted(self.members.values(), key=lambda m: not m.critical)
        return [m.reason or f"{m.name}: {m.state}" for m in members if not m.up]

    def restart(self, name: str, reason: str) -> None:
        """End a child process so that it is restarted."""
        member = self.members[name]
        member.reason = reason
        member.kill()

    def rearm(self, now_s: float) -> None:
        """Reset restart limits, as a person has armed the rig, and retry processes that were given up."""
        for member in self.members.values():
            member.restarts.forgive()
            if member.state is MemberState.FAILED:
                member.enter(MemberState.WAITING, now_s)
                member.due_s = now_s

    def stop_step(self, now_s: float) -> bool:
        """Take one turn of ending the child processes; return whether all have ended."""
        self.stopping = True
        if self.launch is not None and self.launch.fork_server is not None:
            self.launch.fork_server.abandon()
        self.step(now_s)
        others = [m for m in self.members.values() if m.child is not None and m.name != _LAST]
        mine = [m for m in self.members.values() if m.child is not None]
        for member in others or mine:
            if member.state is not MemberState.STOPPING:
                member.enter(MemberState.STOPPING, now_s)
                self._send_end(member)
            elif now_s - member.since_s > END_S and not member.killed:
                self.say("warning", f"{member.name}: did not end within {END_S:.0f} s, killed")
                member.kill()
        return not mine

    def _send_end(self, member: Member) -> None:
        assert member.child is not None
        if member.child.is_stopped():
            member.kill()
        else:
            member.child.send(signal.SIGTERM)  # unlike SIGINT, silent while Python is still importing

    def _forgive_own_delay(self, now_s: float) -> None:
        last, self._last_step_s = self._last_step_s, now_s
        if last is None or now_s - last <= _HELD_UP_S:
            return
        held_up_s = now_s - last
        self._held_up_s = max(self._held_up_s, held_up_s)
        if self._held_up_s > _NOTICE_S and now_s - self._said_held_up_s >= SAY_AGAIN_S:
            worst_ms, self._held_up_s, self._said_held_up_s = self._held_up_s * 1e3, 0.0, now_s
            level = "warning" if self.all_ready else "debug"  # starting processes delay everything
            self.say(level, f"supervisor: held up for {worst_ms:.0f} ms, limit {_NOTICE_S * 1e3:.0f} ms")
        for member in self.members.values():
            member.heard_s += held_up_s
            if member.state is MemberState.HUNG:
                member.since_s += held_up_s
            if member.stream_s is not None:
                member.stream_s += held_up_s

    def _flowing(self) -> set[str]:
        """Return the names of the processes with an active 1 kHz stream.

        This is read from their flight rings; streams of processes without a ring are listened to, all at once.
        Processes that have not reported ready are left out.
        """
        flowing, unknown = set(), {}
        for member in self.members.values():
            if member.spec.stream is None or not hang_detection.says_living(member):
                continue
            ticked = self.loop_progress.ticked(member.name, member.pid)
            if ticked is None:
                unknown[member.spec.stream] = member.name
            elif ticked:
                flowing.add(member.name)
        if unknown:
            heard = self.bus.sample(unknown, time.monotonic_ns() + PATIENCE_NS)
            flowing.update(unknown[stream] for stream in heard)
        return flowing

    def _hear(self, member: Member, now_s: float, flows: bool) -> None:
        frame = self.bus.latest(f"{member.name}.health")
        if frame is not None:
            health: bodies.Health = frame.body
            if member.hear_heartbeat(health, now_s):
                member.stalls.hear_stalls(health.loop.stalls if health.loop else (), starts=not member.came_up)
                if stalls := member.stalls.due_message(now_s):
                    self.say("info", f"{member.name}: {stalls}, by its own measure")
                self._warn(self._floods.messages_from(health, now_s))
                if member.child is None or member.name == "gateway":  # their log is not read here, or not written
                    self._warn(member.new_detail(now_s))
                self.on_report(member.name, health)
                if health.state != "starting":
                    self._prepared.add(member.name)
        if flows:
            member.stream_s = now_s

    def _warn(self, sentences: Iterable[str]) -> None:
        for sentence in sentences:
            self.say("warning", sentence)

    def _read_lines(self, member: Member, now_s: float) -> None:
        assert member.child is not None
        for line in member.child.lines():
            progress = log.parse_progress(line)
            if progress is not None:
                member.advance(progress, now_s)
                continue
            member.last_lines = [*member.last_lines[-19:], line]
            self.say(level_of(line, member.name), line)

    def _is_hearing(self, now_s: float) -> bool:
        """Return whether silence may be judged: all received messages are read, or the bus never becomes idle.

        If no process has been silent for half of the accepted time, there is nothing to judge in this turn.
        """
        if (
            not any(hang_detection.may_be_silent(m, now_s, self.limits) for m in self.members.values())
            or self.has_heard_all()
        ):
            self._heard_all_s = now_s
            return True
        return now_s - self._heard_all_s >= self.limits.heartbeat_s

    def _watch(self, member: Member, now_s: float, hearing: bool, flows: bool) -> None:
        stopped = member.child is not None and not flows and member.child.is_stopped()  # no check after a tick
        if hearing or stopped:
            wrong = hang_detection.hang(member, stopped, now_s, self.limits)
        else:
            wrong = member.reason if member.state is MemberState.HUNG else ""
        match member.state:
            case MemberState.STARTING | MemberState.READY if wrong:
                member.enter(MemberState.HUNG, now_s, wrong)
                self.say("warning", wrong)
            case MemberState.HUNG if not wrong:
                member.stalls_s = [*hang_detection.recent_stalls(member, now_s), now_s]
                member.enter(MemberState.STARTING, now_s)
            case MemberState.HUNG:
                member.reason = wrong
                if not member.killed and hang_detection.beyond_waiting(member, stopped, now_s, self.limits):
                    self._give_up_waiting(member, now_s)
            case MemberState.STARTING if hang_detection.says_ready(member, now_s, self.limits):
                member.enter(MemberState.READY, now_s)
                member.came_up = True
                self._was_ready.add(member.name)
                self.say("info", f"{member.name}: ready (process {member.pid})")
            case MemberState.STARTING if hang_detection.is_overdue(member, now_s, self.limits) and not member.killed:
                member.reason = f"{member.name}: not ready, and no progress for {self.limits.ready_s:.0f} s"
                self._give_up_waiting(member, now_s)

    def _give_up_waiting(self, member: Member, now_s: float) -> None:
        if member.child is not None:
            self.say("warning", f"{member.name}: killed to be started again")
            member.kill()
        else:
            member.enter(MemberState.LOST, now_s, member.reason)
            member.forget_reports()

    def _start_if_due(self, member: Member, now_s: float) -> None:
        if member.state not in (MemberState.WAITING, MemberState.LOST) or self.fatal is not None:
            return
        if self.launch is None:
            if member.health is not None and now_s - member.heard_s <= self.limits.heartbeat_s:
                member.restarts.count += member.state is MemberState.LOST
                member.enter(MemberState.STARTING, now_s)
        elif now_s >= member.due_s and self._predecessors_prepared(member):
            self._start(member, now_s, self.launch)

    def _predecessors_prepared(self, member: Member) -> bool:
        """Return whether the processes before it have prepared; their streams may wait for this one."""
        names = member.spec.starts_after
        return all(name in self._prepared for name in names if name in self.members)

    def _start(self, member: Member, now_s: float, launch: Launch) -> None:
        spec, log_file, forked = member.spec, launch.log_directory / f"{member.name}.log", 0
        if launch.fork_server is not None:
            pid = launch.fork_server.fork(spec.module, launch.arguments, spec.environment, log_file)
            if pid is None:
                return
            forked = pid
        member.forget_reports()
        member.child = Child(spec, launch.arguments, log_file, forked=forked)
        member.enter(MemberState.STARTING, now_s)
        member.progress = ("loading", 0.0)  # until its own report
        self.say("debug", f"{member.name}: started as process {member.pid}")

    def _ended(self, member: Member, status: int, now_s: float) -> None:
        assert member.child is not None
        self._read_lines(member, now_s)
        log_file = member.child.log_file
        member.child.close()
        member.child = None
        first_start = member.name not in self._was_ready and status > 0
        reason = (member.reason if member.killed else "") or f"{member.name}: {how_it_ended(status, member.last_lines)}"
        member.status = status
        if status > 0 and status != EndOfRig.exit_code:
            member.fault = Fault(reason, status)
        elif status < 0 and member.name == "recorder" and member.came_up and not self.stopping:
            member.fault = Fault(f"{reason}; the recording has a hole", HoleError.exit_code)
        member.forget_reports()
        if self.stopping:
            member.enter(MemberState.WAITING, now_s)
            return
        if status == EndOfRig.exit_code:
            self.ended_by_person = True
            self.say("info", f"{member.name}: a person has ended the rig there")
            member.enter(MemberState.WAITING, now_s)
            return
        if first_start:
            self.fatal = Fault(start_sentence(member, status, log_file), status)
            member.enter(MemberState.FAILED, now_s, reason)
            return
        has_room = status != RecordingError.exit_code
        delay_s = member.restarts.delay_s(now_s) if member.may_restart and has_room else None
        if delay_s is None:
            limit = "restarted too often within a minute" if member.may_restart else "not to be restarted"
            limit = limit if has_room else "records again when there is room and the rig is armed"
            member.enter(MemberState.FAILED, now_s, f"{reason}; {limit}, given up")
        else:
            member.enter(MemberState.LOST, now_s, reason)
            member.due_s = now_s + delay_s
        self.say("error", member.reason)
