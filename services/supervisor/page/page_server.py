"""The page's process: ``python -m trocar.services.supervisor.page.page_server LINK SOCKET``, started by the supervisor.

It receives the processes' reports on the bus, and the supervisor's judgement over the link. It ends with the link, that
is with the supervisor.
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
from typing import get_args

import msgspec

import trocar.protocol.bodies as bodies
from trocar.services.diagnosis.thread_usage import ThreadUsage
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.process.process import listen_as
from trocar.services.runtime.realtime.autogroup import set_group_niceness
from trocar.services.runtime.web.web_certificate import load_for
from trocar.services.runtime.web.web_server import make_server, serve_until
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page import command_socket as control
from trocar.services.supervisor.page import dashboard
from trocar.services.supervisor.page.metrics import Level, RigSource, registry
from trocar.services.supervisor.page.page_link import STATUS_S, Heartbeat, Link, PageSetup, RigStatus
from trocar.services.supervisor.page.task_metrics import Task
from trocar.services.supervisor.page.web import PageContext, build_app

_HEALTHY = (RigState.READY, RigState.RUNNING, RigState.DEGRADED)
#: Silence of the supervisor after which the page is marked as outdated.
SILENT_S = 2.0
#: It needs a twentieth of a core and answers a person, so it precedes computing processes of the ordinary class.
_NICE = -10
#: Name of the supervisor, whose turns are measured like those of other processes.
OURS = "supervisor"
_encoder = msgspec.json.Encoder()


@dataclass
class PageData:
    """The page's data on the rig."""

    rig: Rig
    threads: ThreadUsage = field(default_factory=ThreadUsage)
    status: RigStatus | None = None
    task: Task = field(default_factory=Task)
    heard: dict[str, dashboard.Heard] = field(default_factory=dict)

    def hear_reports(self, bus: Bus) -> None:
        """Receive the newest report of every process."""
        if self.status is None:
            return
        if self.status.replay is not None and self.status.replay.attempt is not None:
            self.task.attempt = self.status.replay.attempt
        elif self.rig.process("training").enabled and (frame := bus.latest("training.attempt")) is not None:
            self.task.see_attempt(frame.body)
        for name in (*(process.name for process in self.status.state.processes), OURS):
            heard = self.heard.setdefault(name, dashboard.Heard.nothing(self.rig.supervisor.window_s))
            frame = bus.latest(f"{name}.health")
            if frame is not None:
                heard.take_report(frame.body)

    def sample_threads(self, status: RigStatus) -> None:
        """Look at the threads of the rig's processes, if that is due."""
        pids = {process.name: process.pid for process in status.state.processes}
        self.threads.sample(time.monotonic(), pids | {OURS: os.getppid()})

    def healthy(self) -> tuple[bool, str]:
        """Return whether the rig works, with a description."""
        if self.status is None:
            return False, "the supervisor has said nothing yet"
        silent_s, state = time.monotonic() - self.status.said_s, self.status.state
        if silent_s > SILENT_S:
            return False, f"the supervisor has said nothing for {silent_s:.1f} s"
        reason = f": {state.reason}" if state.reason else ""
        return state.state in _HEALTHY, f"{state.state}{reason}"

    def source(self) -> RigSource:
        """Return the data exported to Prometheus."""
        if self.status is None:
            return RigSource(bodies.SupervisorState(state=RigState.OFF))
        is_judged = time.monotonic() - self.status.said_s < SILENT_S
        contracts = self.rig.contracts
        return RigSource(self.status.state, self.reports(), self.threads.report(), is_judged, contracts, self.task)

    def reports(self) -> dict[str, bodies.Health]:
        """Return the newest report of every process."""
        return {name: one.health for name, one in self.heard.items() if one.health is not None}

    def view_port(self) -> int:
        """Return the port of the picture, reported by its process if it was not configured."""
        heard = self.heard.get("visualization")
        said = heard.health.gauges.get("view_port") if heard is not None and heard.health is not None else None
        return int(said) if said else self.rig.visualization.port


def main(link_descriptor: int, socket_descriptor: int) -> int:
    """Serve until the supervisor ends; return the exit code."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
        set_group_niceness(_NICE)
    link = Link(socket.socket(fileno=link_descriptor))
    sock = socket.socket(fileno=socket_descriptor)
    setup = link.wait(PageSetup)
    if setup is None:
        return 1
    rig = Rig.model_validate_json(setup.rig)
    _run(PageData(rig), setup, link, sock)
    return 0


def _run(page_data: PageData, setup: PageSetup, link: Link, sock: socket.socket) -> None:
    """Serve until the supervisor ends."""
    context = PageContext(
        rig=page_data.rig,
        scene=setup.scene,
        registries={level: registry(page_data.source, level) for level in get_args(Level)},
        ask=lambda command: control.ask_rig(page_data.rig.transport, command),
        replays=lambda: page_data.status is not None and page_data.status.replay is not None,
        switches=setup.switches,
        healthy=page_data.healthy,
        view_port=page_data.view_port,
        token=setup.token,
        class_token=_class_token(page_data.rig),
    )
    with closing(listen_as(OURS, page_data.rig)) as bus:
        asyncio.run(_serve(context, page_data, bus, link, sock))


def _class_token(rig: Rig) -> str:
    """Return the token of the class that a rig belongs to, empty for none, or if its file cannot be read."""
    path = rig.supervisor.web.class_token
    with contextlib.suppress(OSError, UnicodeDecodeError):
        return path.read_text(encoding="utf-8").strip() if path is not None else ""
    return ""


async def _serve(context: PageContext, page_data: PageData, bus: Bus, link: Link, sock: socket.socket) -> None:
    server = make_server(build_app(context), load_for(context.rig), log_level="error")
    await serve_until(server, sock, lambda: not _follow(context, page_data, bus, link), STATUS_S)


def _follow(context: PageContext, page_data: PageData, bus: Bus, link: Link) -> bool:
    """Update the page's data; return False once the supervisor has ended."""
    try:
        page_data.status = link.newest(RigStatus) or page_data.status
    except ConnectionError:
        context.closing = True
        return False
    page_data.hear_reports(bus)
    status = page_data.status
    if status is not None:
        page_data.sample_threads(status)
        link.send(Heartbeat())
        context.latest = _encoder.encode(
            dashboard.snapshot(
                status,
                page_data.heard,
                page_data.rig,
                context.scene,
                page_data.threads.report(),
                page_data.task.attempt,
            )
        )
    return True


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
