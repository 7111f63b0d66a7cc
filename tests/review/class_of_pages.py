"""Rigs as a class sees them: the real page's server, ten of it in one process, fed with made-up states."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import uvicorn
from starlette.types import ASGIApp

from tests.patience import PATIENCE_S
from tests.supervisor.made_up import rig
from trocar.services.runtime.web.web_certificate import Certificate
from trocar.services.runtime.web.web_host import listen
from trocar.services.supervisor.page.web import PageContext, build_app

TOKEN = "of the whole class 7"


def state(**given: Any) -> bytes:
    """Return what a rig's page tells, with more in it than a class takes."""
    loops = [{"name": name, "state": "ready", "loop": {"contract_ok": True, "rate_hz": None}} for name in ("physics",)]
    attempt = {"state": "running", "title": "Insert", "phase": "P3", "time_s": 12.5, "depth_m": 0.02,
               "goal_depth_m": 0.04, "errors": {"E1": 2}, "outcome": ""}  # fmt: skip
    told = {"state": "running", "reason": "", "processes": loops, "paths": [{"name": "servo", "ok": True}],
            "attempt": attempt, "heat": {"physics": [1] * 50}, **given}  # fmt: skip
    return msgspec.json.encode(told)


def page() -> PageContext:
    """Return what a rig's page server is made of; its `latest` is what it tells."""
    never: Callable[..., Any] = lambda *_: None  # noqa: E731
    return PageContext(
        rig=rig(), scene="default", registries={}, ask=never,
        healthy=lambda: (True, "running"), view_port=lambda: 1, latest=state(),
    )  # fmt: skip


@contextmanager
def served(*apps: ASGIApp, certificate: Certificate | None = None) -> Iterator[list[str]]:
    """Serve applications from one thread, encrypted if there is a certificate; yield their addresses."""
    encrypted: dict[str, Any] = {} if certificate is None else certificate.server_options()
    options = {"log_level": "error", "lifespan": "off", "ws": "none", "timeout_graceful_shutdown": 1, **encrypted}
    sockets = [listen("127.0.0.1", 0, "nothing") for _ in apps]
    servers = [uvicorn.Server(uvicorn.Config(app, **options)) for app in apps]

    async def run() -> None:
        await asyncio.gather(*(s.serve(sockets=[end]) for s, end in zip(servers, sockets, strict=True)))
        left = [connection for server in servers for connection in server.server_state.connections]
        for connection in left:  # a page that listens has one, which its server waits for a second and then forgets
            connection.transport.abort()
        await asyncio.sleep(0)  # closes them

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    try:
        until(lambda: all(server.started for server in servers), "served")
        scheme = "https" if encrypted else "http"
        yield [f"{scheme}://127.0.0.1:{end.getsockname()[1]}" for end in sockets]
    finally:
        for server in servers:
            server.should_exit = True
        thread.join(30)
        for end in sockets:
            end.close()


@contextmanager
def rigs(count: int) -> Iterator[tuple[list[PageContext], list[str]]]:
    """Serve so many pages; yield what each is made of, and where it is."""
    contexts = [page() for _ in range(count)]
    with served(*(build_app(context) for context in contexts)) as addresses:
        yield contexts, addresses


def write_roll(file: Path, addresses: list[str], *, more: str = "", **trainees: str) -> Path:
    """Write the file of a class whose rigs are called bench-0, bench-1, ..."""
    rows = [
        f'[[rig]]\nname = "bench-{k}"\naddress = "{address}"\ntrainee = "{trainees.get(f"bench_{k}", "")}"'
        for k, address in enumerate(addresses)
    ]
    file.write_text("\n".join([f'token = "{TOKEN}"', more, *rows]) + "\n")
    return file


def until(condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
    end_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end_s, f"not within {patience_s} s: {what}"
        time.sleep(0.05)
