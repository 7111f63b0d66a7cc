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
from trocar.services.supervisor.page.helper import Lifeline
from trocar.services.supervisor.page.metrics import Level, RigSource, registry
from trocar.services.supervisor.page.page_place import PageFile, read_page_file
from trocar.services.supervisor.page.rig_listener import JUDGEMENT, TOPICS, RigListener
from trocar.services.supervisor.page.task_metrics import Task
from trocar.services.supervisor.page.web import PageContext, build_app

_HEALTHY = (RigState.READY, RigState.RUNNING, RigState.DEGRADED)
ATTEMPT = "training.attempt"
#: Silence of the supervisor after which the page is marked as outdated.
SILENT_S = topic(JUDGEMENT).stale_after_s
#: It needs a twentieth of a core and answers a person, so it precedes computing processes of the ordinary class.
_NICE = -10
#: Name of the supervisor, whose turns are measured like those of other processes.
OURS = "supervisor"
_encoder = msgspec.json.Encoder()


class PageData:
    """The page's data on the rig, all from the bus."""

    def __init__(self, rig: Rig) -> None:
        names = [name for name in PROCESSES if rig.process(name).enabled]
        self.rig = rig
        self.listener = RigListener(rig.supervisor.window_s, names)
        self.threads = ThreadUsage()
        self.task = Task()

    def hear_rig(self, bus: Bus) -> None:
        """Receive the newest of every topic, and look at the threads of the rig's processes, if that is due."""
        self.listener.hear_all(bus, time.monotonic())
        told = self.listener.judgement
        if told is not None and told.replay is not None and told.replay.attempt is not None:
            self.task.attempt = told.replay.attempt
        elif "training" in self.listener.heard and (attempt := bus.latest(ATTEMPT)) is not None:
            self.task.see_attempt(attempt.body)
        reports = self.listener.state.processes if self.listener.state is not None else ()
        self.threads.sample(time.monotonic(), {each.name: each.pid for each in reports} | {OURS: os.getppid()})

    def healthy(self) -> tuple[bool, str]:
        """Return whether the rig works, with a description."""
        state = self.listener.state
        if state is None or self.listener.judgement is None:
            return False, "the supervisor has said nothing yet"
        if (silent_s := time.monotonic() - self.listener.judged_s) > SILENT_S:
            return False, f"the supervisor has said nothing for {silent_s:.1f} s"
        return state.state in _HEALTHY, f"{state.state}{f': {state.reason}' if state.reason else ''}"

    def replays(self) -> bool:
        """Return whether a recording is shown."""
        told = self.listener.judgement
        return told is not None and told.replay is not None

    def source(self) -> RigSource:
        """Return the data exported to Prometheus."""
        state = self.listener.state
        if state is None or self.listener.judgement is None:
            return RigSource(bodies.SupervisorState(state=RigState.OFF))
        is_judged = time.monotonic() - self.listener.judged_s < SILENT_S
        reports, threads = self.listener.reports, self.threads.report()
        return RigSource(state, reports, threads, is_judged, self.rig.contracts, self.task)

    def snapshot(self, scene: str) -> dashboard.DashboardSnapshot | None:
        """Return what the page shows, None before the supervisor has said anything."""
        state, told, heard = self.listener.state, self.listener.judgement, self.listener.heard
        if state is None or told is None:
            return None
        return dashboard.snapshot(state, told, heard, self.rig, scene, self.threads.report(), self.task.attempt)

    def view_port(self) -> int:
        """Return the port of the picture, reported by its process if it was not configured."""
        heard = self.listener.heard.get("visualization")
        said = heard.health.gauges.get("view_port") if heard is not None and heard.health is not None else None
        return int(said) if said else self.rig.visualization.port


def main(place: Path, lifeline: Lifeline, sock: socket.socket) -> None:
    """Serve until the supervisor ends."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
        set_group_niceness(_NICE)
    content = read_page_file(place)
    page_data = PageData(Rig.model_validate_json(content.rig))
    with closing(observe(page_data.rig, (ATTEMPT, *TOPICS))) as bus:
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
    if (shown := page_data.snapshot(context.scene)) is not None:
        context.latest = _encoder.encode(shown)
    return True


if __name__ == "__main__":
    main(Path(sys.argv[1]), Lifeline.of(int(sys.argv[2])), socket.socket(fileno=int(sys.argv[3])))
