"""The web page of a running supervisor: its socket, its thread, and who may command through it."""

from __future__ import annotations

import socket
import threading
from types import TracebackType
from typing import Self

import msgspec
import uvicorn

from services.supervisor import dashboard
from services.supervisor.metrics import RigSource, Source, registry
from services.supervisor.page_place import page_file, write_page_file
from services.supervisor.state_machine import RigState
from services.supervisor.supervisor import Supervisor
from services.supervisor.web import EVENT_PERIOD_S, PageContext, build_app

_HEALTHY = (RigState.READY, RigState.RUNNING, RigState.DEGRADED)
_encoder = msgspec.json.Encoder()


class Page:
    """Serves while it is open. The supervisor's loop only replaces one bytes object; no client can hold it up."""

    def __init__(self, sock: socket.socket, supervisor: Supervisor, scene: str) -> None:
        self._supervisor = supervisor
        self._socket = sock
        self._due_s = 0.0
        self.context = PageContext(
            rig=supervisor.rig,
            scene=scene,
            registry=registry(self._source),
            arm=supervisor.arm,
            safe_stop=supervisor.safe_stop,
            healthy=self._healthy,
            view_port=self._view_port,
        )
        host, port = sock.getsockname()[:2]
        host = "127.0.0.1" if host == "0.0.0.0" else "[::1]" if host == "::" else host
        self.address = f"http://{host}:{port}/"
        config = uvicorn.Config(
            build_app(self.context), log_level="error", access_log=False, lifespan="off", ws="none",
            timeout_graceful_shutdown=1,
        )  # fmt: skip
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, args=([sock],), name="page", daemon=True)
        self._file = page_file(supervisor.rig.transport)

    def __enter__(self) -> Self:
        write_page_file(self._file, self.address, self.context.token)
        self._supervisor.page_address = f"{self.address}#token={self.context.token}"
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.context.closing = True
        self._server.should_exit = True
        self._thread.join(3.0)
        self._socket.close()
        self._file.unlink(missing_ok=True)

    def turn(self, now_s: float) -> None:
        """Replace what the page shows, when it is due."""
        if now_s >= self._due_s:
            self._due_s = now_s + EVENT_PERIOD_S
            self.context.latest = _encoder.encode(dashboard.snapshot(self._supervisor, self.context.scene, now_s))

    def _source(self) -> RigSource:
        supervisor = self._supervisor
        body = supervisor.body()
        processes = [Source(m.name, m.up, m.restarts.count, m.health) for m in supervisor.crew.members.values()]
        return RigSource(supervisor.state, body.quality_level, body.safe_stop, processes)

    def _healthy(self) -> tuple[bool, str]:
        state = self._supervisor.state
        return state in _HEALTHY, f"{state}{': ' if self._supervisor.reason else ''}{self._supervisor.reason}"

    def _view_port(self) -> int:
        """Return where the picture is served: as the process says, where it was left to choose."""
        member = self._supervisor.crew.members.get("visualization")
        said = member.health.gauges.get("view_port") if member and member.health else None
        return int(said) if said else self._supervisor.rig.visualization.port
