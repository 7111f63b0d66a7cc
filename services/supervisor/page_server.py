"""The page's process: ``python -m services.supervisor.page_server LINK SOCKET``, started by the supervisor only.

It hears the processes' reports on the bus as any observer, and the supervisor's judgement over the link. Its end of the
link is its life: when the supervisor goes, it goes.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import sys
import time
from contextlib import closing
from dataclasses import dataclass, field

import msgspec
import uvicorn

from services.runtime.autogroup import set_group_niceness
from services.runtime.bus import Bus
from services.runtime.process import listen_as
from services.runtime.rig import Rig
from services.supervisor import dashboard
from services.supervisor.around import Around
from services.supervisor.metrics import RigSource, Source, registry
from services.supervisor.notes import Command, Link, Notes, Opening
from services.supervisor.state_machine import RigState
from services.supervisor.web import EVENT_PERIOD_S, PageContext, build_app

_HEALTHY = (RigState.READY, RigState.RUNNING, RigState.DEGRADED)
#: A supervisor that has said nothing for so long does not run: what is shown is old.
SILENT_S = 2.0
_OPENING_S = 10.0
#: It needs a twentieth of a core and answers a person: of the ordinary class, it is served before what computes.
_NICE = -10
#: Whose page this is: no member of the crew, but its turns are measured as everybody's.
OURS = "supervisor"
_encoder = msgspec.json.Encoder()


@dataclass
class Knowledge:
    """What the page's process knows of the rig."""

    rig: Rig
    around: Around
    notes: Notes | None = None
    heard: dict[str, dashboard.Heard] = field(default_factory=dict)

    def hear(self, bus: Bus) -> None:
        """Take the newest report of every process."""
        if self.notes is None:
            return
        for name in (*(member.name for member in self.notes.members), OURS):
            heard = self.heard.setdefault(name, dashboard.Heard.nothing(self.rig.supervisor.window_s))
            frame = bus.latest(f"{name}.health")
            if frame is not None:
                heard.take(frame.body)

    def healthy(self) -> tuple[bool, str]:
        """Return whether the rig does what it is for, and in which words."""
        if self.notes is None:
            return False, "the supervisor has said nothing yet"
        silent_s = time.monotonic() - self.notes.said_s
        if silent_s > SILENT_S:
            return False, f"the supervisor has said nothing for {silent_s:.1f} s"
        reason = f": {self.notes.reason}" if self.notes.reason else ""
        return self.notes.state in _HEALTHY, f"{self.notes.state}{reason}"

    def source(self) -> RigSource:
        """Return what is exported to Prometheus."""
        if self.notes is None:
            return RigSource(RigState.OFF, 0, False, ())
        heard = {name: one.health for name, one in self.heard.items()}
        processes = [Source(m.name, m.up, m.restarts, heard.get(m.name)) for m in self.notes.members]
        processes.append(Source(OURS, time.monotonic() - self.notes.said_s < SILENT_S, 0, heard.get(OURS)))
        return RigSource(
            state=RigState(self.notes.state),
            quality_level=self.notes.quality_level,
            quality=self.notes.quality,
            safe_stop=self.notes.safe_stop,
            processes=processes,
            threads=self.around.threads.totals(),
            floor=self.around.floor(),
        )

    def view_port(self) -> int:
        """Return where the picture is served: as its process says, where it was left to choose."""
        heard = self.heard.get("visualization")
        said = heard.health.gauges.get("view_port") if heard is not None and heard.health is not None else None
        return int(said) if said else self.rig.visualization.port


def main(link_descriptor: int, socket_descriptor: int) -> int:
    """Serve until the supervisor goes; return the exit code."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
        set_group_niceness(_NICE)
    link = Link(socket.socket(fileno=link_descriptor))
    sock = socket.socket(fileno=socket_descriptor)
    opening = link.wait(Opening, _OPENING_S)
    if opening is None:
        return 1
    rig = Rig.model_validate_json(opening.rig)
    with closing(Around(rig)) as around:
        _run(Knowledge(rig, around), opening, link, sock)
    return 0


def _run(knowledge: Knowledge, opening: Opening, link: Link, sock: socket.socket) -> None:
    """Serve until the supervisor goes."""
    context = PageContext(
        rig=knowledge.rig,
        scene=opening.scene,
        registry=registry(knowledge.source),
        arm=lambda who: _ask(link, Command("arm", who)),
        safe_stop=lambda who: _ask(link, Command("safe_stop", who)),
        healthy=knowledge.healthy,
        view_port=knowledge.view_port,
        token=opening.token,
    )
    bus = listen_as(OURS, knowledge.rig)
    try:
        asyncio.run(_serve(context, knowledge, bus, link, sock))
    finally:
        bus.close()


def _ask(link: Link, command: Command) -> None:
    """Pass on what a person asked for; the answer is the state that everybody is shown."""
    if not link.send(command):
        raise ConnectionError("the supervisor does not listen")


async def _serve(context: PageContext, knowledge: Knowledge, bus: Bus, link: Link, sock: socket.socket) -> None:
    config = uvicorn.Config(
        build_app(context), log_level="error", access_log=False, lifespan="off", ws="none", timeout_graceful_shutdown=1
    )  # fmt: skip
    server = uvicorn.Server(config)
    following = asyncio.create_task(_follow(context, knowledge, bus, link, server))
    await server.serve(sockets=[sock])
    following.cancel()


async def _follow(context: PageContext, knowledge: Knowledge, bus: Bus, link: Link, server: uvicorn.Server) -> None:
    """Replace what the page shows, five times a second, until the supervisor is gone."""
    while True:
        try:
            while (said := link.receive(Notes)) is not None:
                knowledge.notes = said
        except ConnectionError:
            context.closing = True
            server.should_exit = True
            return
        knowledge.hear(bus)
        if knowledge.notes is not None:
            await knowledge.around.turn(knowledge.notes, {n: h.health for n, h in knowledge.heard.items() if h.health})
            around = knowledge.around.shown()
            shown = dashboard.snapshot(knowledge.notes, knowledge.heard, knowledge.rig, context.scene, around)
            context.latest = _encoder.encode(shown)
        await asyncio.sleep(EVENT_PERIOD_S)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
