"""The page's process: ``python -m trocar.services.supervisor.page.page_server FILE LIFELINE SOCKET``.

It reads the processes' reports and the supervisor's judgement from the bus, as any observer. The supervisor starts it,
and it ends with the supervisor.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import asyncio
import contextlib
import os
import socket
import sys
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

import msgspec

import trocar.protocol.bodies as bodies
from trocar.protocol import PROCESSES, topic
from trocar.protocol.topics import JUDGEMENT_S
from trocar.services.diagnosis.thread_usage import ThreadUsage
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.process.process import observe
from trocar.services.runtime.realtime.autogroup import set_group_niceness
from trocar.services.runtime.web.web_certificate import load_for
from trocar.services.runtime.web.web_server import make_server, serve_until
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page import command_socket as control
from trocar.services.supervisor.page import dashboard
from trocar.services.supervisor.page.lifeline import Lifeline
from trocar.services.supervisor.page.metrics import Level, RigSource, registry
from trocar.services.supervisor.page.page_place import PageFile, read_page_file
from trocar.services.supervisor.page.task_metrics import Task
from trocar.services.supervisor.page.web import PageContext, build_app

_HEALTHY = (RigState.READY, RigState.RUNNING, RigState.DEGRADED)
STATE, JUDGEMENT, ATTEMPT = "supervisor.state", "supervisor.judgement", "training.attempt"
#: All that the page reads.
TOPICS = (STATE, JUDGEMENT, ATTEMPT, *(f"{name}.health" for name in PROCESSES))
#: Silence of the supervisor after which the page is marked as outdated.
SILENT_S = topic(JUDGEMENT).stale_after_s
#: It needs a twentieth of a core and answers a person, so it precedes computing processes of the ordinary class.
_NICE = -10
#: Name of the supervisor, whose turns are measured like those of other processes.
OURS = "supervisor"
_encoder = msgspec.json.Encoder()


@dataclass
class PageData:
    """The page's data on the rig, all from the bus: what its processes and its supervisor publish.

    `state` and `judgement` are the supervisor's newest, None before the first; `heard_s` is when the judgement came.
    """

    rig: Rig
    threads: ThreadUsage = field(default_factory=ThreadUsage)
    state: bodies.SupervisorState | None = None
    judgement: bodies.Judgement | None = None
    heard_s: float = 0.0
    task: Task = field(default_factory=Task)
    heard: dict[str, dashboard.Heard] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the processes that the rig runs, with the supervisor."""
        return tuple(name for name in PROCESSES if self.rig.process(name).enabled)

    def hear_rig(self, bus: Bus) -> None:
        """Receive the newest of every topic."""
        for frame in bus.drain(STATE):
            self.state = frame.body
        if (told := bus.latest(JUDGEMENT)) is not None:
            self.judgement, self.heard_s = told.body, time.monotonic()
        replay = self.judgement.replay if self.judgement is not None else None
        if replay is not None and replay.attempt is not None:
            self.task.attempt = replay.attempt
        elif "training" in self.names and (attempt := bus.latest(ATTEMPT)) is not None:
            self.task.see_attempt(attempt.body)
        for name in self.names:
            heard = self.heard.setdefault(name, dashboard.Heard.nothing(self.rig.supervisor.window_s))
            if (report := bus.latest(f"{name}.health")) is not None:
                heard.take_report(report.body)

    def sample_threads(self) -> None:
        """Look at the threads of the rig's processes, if that is due."""
        reports = self.state.processes if self.state is not None else ()
        self.threads.sample(time.monotonic(), {each.name: each.pid for each in reports} | {OURS: os.getppid()})

    def healthy(self) -> tuple[bool, str]:
        """Return whether the rig works, with a description."""
        if self.state is None or self.judgement is None:
            return False, "the supervisor has said nothing yet"
        if (silent_s := time.monotonic() - self.heard_s) > SILENT_S:
            return False, f"the supervisor has said nothing for {silent_s:.1f} s"
        reason = f": {self.state.reason}" if self.state.reason else ""
        return self.state.state in _HEALTHY, f"{self.state.state}{reason}"

    def replays(self) -> bool:
        """Return whether a recording is shown."""
        return self.judgement is not None and self.judgement.replay is not None

    def source(self) -> RigSource:
        """Return the data exported to Prometheus."""
        if self.state is None or self.judgement is None:
            return RigSource(bodies.SupervisorState(state=RigState.OFF))
        is_judged = time.monotonic() - self.heard_s < SILENT_S
        contracts = self.rig.contracts
        return RigSource(self.state, self.reports(), self.threads.report(), is_judged, contracts, self.task)

    def snapshot(self, scene: str) -> dashboard.DashboardSnapshot | None:
        """Return what the page shows, None before the supervisor has said anything."""
        if self.state is None or self.judgement is None:
            return None
        attempt, threads = self.task.attempt, self.threads.report()
        return dashboard.snapshot(self.state, self.judgement, self.heard, self.rig, scene, threads, attempt)

    def reports(self) -> dict[str, bodies.Health]:
        """Return the newest report of every process."""
        return {name: one.health for name, one in self.heard.items() if one.health is not None}

    def view_port(self) -> int:
        """Return the port of the picture, reported by its process if it was not configured."""
        heard = self.heard.get("visualization")
        said = heard.health.gauges.get("view_port") if heard is not None and heard.health is not None else None
        return int(said) if said else self.rig.visualization.port


def main(place: Path, lifeline: Lifeline, sock: socket.socket) -> None:
    """Serve until the supervisor ends."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
        set_group_niceness(_NICE)
    content = read_page_file(place)
    page_data = PageData(Rig.model_validate_json(content.rig))
    with closing(observe(page_data.rig, TOPICS)) as bus:
        asyncio.run(_serve(_context(page_data, content), page_data, bus, lifeline, sock))


def _context(page_data: PageData, content: PageFile) -> PageContext:
    return PageContext(
        rig=page_data.rig,
        scene=content.scene,
        registries={level: registry(page_data.source, level) for level in get_args(Level)},
        ask=lambda command: control.ask_rig(page_data.rig.transport, command),
        replays=page_data.replays,
        switches=content.switches,
        healthy=page_data.healthy,
        view_port=page_data.view_port,
        token=content.token,
        class_token=_class_token(page_data.rig),
    )


def _class_token(rig: Rig) -> str:
    """Return the token of the class that a rig belongs to, empty for none, or if its file cannot be read."""
    path = rig.supervisor.web.class_token
    with contextlib.suppress(OSError, UnicodeDecodeError):
        return path.read_text(encoding="utf-8").strip() if path is not None else ""
    return ""


async def _serve(context: PageContext, page_data: PageData, bus: Bus, lifeline: Lifeline, sock: socket.socket) -> None:
    server = make_server(build_app(context), load_for(context.rig), log_level="error")
    await serve_until(server, sock, lambda: not _follow(context, page_data, bus, lifeline), JUDGEMENT_S)


def _follow(context: PageContext, page_data: PageData, bus: Bus, lifeline: Lifeline) -> bool:
    """Update the page's data; return False once the supervisor has ended."""
    if not lifeline.beat():
        context.closing = True
        return False
    page_data.hear_rig(bus)
    page_data.sample_threads()
    if (shown := page_data.snapshot(context.scene)) is not None:
        context.latest = _encoder.encode(shown)
    return True


if __name__ == "__main__":
    main(Path(sys.argv[1]), Lifeline.of(int(sys.argv[2])), socket.socket(fileno=int(sys.argv[3])))
