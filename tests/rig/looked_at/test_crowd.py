"""Ten viewers, one who stops reading and a storm of reloads at a true rig: bounded memory, and loops that go on."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.patience import PATIENCE_S
from tests.rig.conftest import Rig
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport

pytestmark = [pytest.mark.rig, pytest.mark.timeout(900)]

VIEWERS = 10
#: Reloads before memory is looked at for the first time, and after.
FIRST, MORE = 10, 50
UPGRADE = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13", f"Sec-WebSocket-Key: {'A' * 22}==")
#: Of each process: a picture's buffers that stay with every reload would be more.
MOST_GROWTH_BYTES = 4 << 20


def test_a_crowd_at_the_page_costs_bounded_memory_and_no_loop_anything(rig: Rig, address: str) -> None:
    with ExitStack() as stack:
        view = httpx.get(f"{address}api/rig", timeout=PATIENCE_S).json()["view_ws"]
        bus = ZmqBus(Transport(directory=rig.directory / "bus"), samples=["gateway.state"])
        stack.callback(bus.close)
        members, alone_hz = rig.observer.pids().values(), _ticks_a_second(bus)
        viewers = [stack.enter_context(_view(view)) for _ in range(VIEWERS)]
        still = [stack.enter_context(_ask(address, "/events")), stack.enter_context(_ask(view, "/ws", *UPGRADE))]
        _storm(address, view, FIRST)
        held = _still_memory(rig)
        began_s, began = time.monotonic(), _tick(bus)
        _storm(address, view, MORE)
        crowded_hz = (_tick(bus) - began) / (time.monotonic() - began_s)
        grown = {name: size - held[name] for name, size in _memory(rig).items()}
        assert len(grown) > len(members), "the page too"
        assert max(grown.values()) < MOST_GROWTH_BYTES, grown
        assert crowded_hz > 0.5 * alone_hz, "the loops do not wait for a crowd, though a busy machine has less for them"
        ticks = [_picture(viewer) for viewer in viewers]
        assert max(ticks) - min(ticks) < 60.0 * crowded_hz, "all see the same minute"
        assert all(_picture(viewer) >= tick for viewer, tick in zip(viewers, ticks, strict=True)), "all see it go on"
        for each in still:
            each.close()
        assert all(Path(f"/proc/{pid}").exists() for pid in members), "none was started anew"


def _still_memory(rig: Rig) -> dict[int, int]:
    """Return what each process holds, once all have imported what they need: the school's process starts last."""
    deadline_s, held = time.monotonic() + PATIENCE_S, _memory(rig)
    while True:
        time.sleep(2.0)
        before, held = held, _memory(rig)
        if before.keys() == held.keys() and max(held[pid] - before[pid] for pid in held) < MOST_GROWTH_BYTES // 16:
            return held
        assert time.monotonic() < deadline_s


def _ask(address: str, path: str, *more: str) -> socket.socket:
    """Ask for something, and read nothing of the answer."""
    parts = urlsplit(address)
    made = socket.create_connection((parts.hostname or "", parts.port or 0), timeout=PATIENCE_S)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.sendall("\r\n".join((f"GET {path} HTTP/1.1", "Host: localhost", *more, "", "")).encode())
    return made


@contextmanager
def _view(view: str) -> Iterator[ClientConnection]:
    """Look at the picture; what has not been read by the end is nobody's."""
    leaves = False
    try:
        with connect(view, compression=None, close_timeout=0.1, ping_interval=None) as client:
            yield client
            leaves = True
    except ConnectionClosed:
        if not leaves:
            raise


def _storm(address: str, view: str, turns: int) -> None:
    """Load the page and leave it in the middle, again and again."""
    with httpx.Client(timeout=PATIENCE_S) as page:
        for turn in range(turns):
            with _ask(address, "/events") as events, _view(view) as client:
                if turn % 2:
                    events.recv(1000)
                    _picture(client)
            assert page.get(address).status_code == 200


def _picture(client: ClientConnection) -> int:
    """Return the tick of the next picture, which it acknowledges."""
    while True:
        message = client.recv(timeout=PATIENCE_S)
        if isinstance(message, bytes):
            sequence, _, _, tick = struct.unpack_from("<4Q", message)
            client.send(struct.pack("<Q", sequence))
            return int(tick)


def _memory(rig: Rig) -> dict[int, int]:
    """Return the resident bytes of each process of the rig: those that it tells, its supervisor and their children."""
    sizes, parents = {}, {}
    for folder in Path("/proc").iterdir():
        with suppress(OSError, ValueError):  # no process, or gone meanwhile
            status = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines())
            parents[int(folder.name)] = int(status["PPid"])
            sizes[int(folder.name)] = 1024 * int(status.get("VmRSS", "0 kB").split()[0])
    ours = {rig.process.pid, *rig.observer.pids().values()}
    while more := {pid for pid, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return {pid: sizes[pid] for pid in ours if pid in sizes}


def _tick(bus: ZmqBus) -> int:
    """Return a tick that the gateway tells now."""
    tick: int = bus.sample(["gateway.state"], time.monotonic_ns() + round(1e9 * PATIENCE_S))["gateway.state"].body.tick
    return tick


def _ticks_a_second(bus: ZmqBus) -> float:
    began_s, began = time.monotonic(), _tick(bus)
    time.sleep(0.5)
    return (_tick(bus) - began) / (time.monotonic() - began_s)
