"""A stand-in of Haply's service 3.5, by its public protocol: an inventory, then one answer for each message.

``python -m tests.gateway.devices.haply_service PORT`` serves two arms and obeys its standard input until that
ends; then it prints their forces.
"""

from __future__ import annotations

import contextlib
import copy
import json
import math
import os
import select
import socket
import sys
import time
from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np
from websockets.frames import Opcode
from websockets.http11 import Request
from websockets.server import ServerProtocol

from tests.gateway.devices.bench import SteppedClock

CENTRE_M = (0.0, -0.12, 0.15)
#: Time after its last command after which an arm is idle.
IDLE_S = 0.01
_IDENTITY: dict[str, Any] = {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "scale": {"x": 1.0, "y": 1.0, "z": 1.0}}

Answer = dict[str, Any]


def xyz(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


class StandInArm:
    """An arm: where it is, what force it applies, how it is set."""

    def __init__(self, kind: str) -> None:
        self.plugged = True
        self.place: Callable[[float], tuple[float, float, float]] = lambda _now_s: CENTRE_M
        self.force_n = np.zeros(3)
        self.status: dict[str, Any] = {"calibrated": True, "power_supply": True, "ready": True, "in_use": True}
        self.config: dict[str, Any] = {
            "type": kind,
            "handedness": "right",
            "basis": {"permutation": "XZY"},
            "mount": copy.deepcopy(_IDENTITY),
            "gravity_compensation": {"enabled": False, "scaling_factor": 1.0},
            "filters": {"force_gate": {"gain": 0.1}, "damping": {"scalar": 4.0}},
        }
        self.commanded_s = -1.0

    def command(self, commands: dict[str, Any], now_s: float) -> None:
        if "set_cursor_force" in commands:
            vector = commands["set_cursor_force"]["vector"]
            self.force_n = np.array([vector["x"], vector["y"], vector["z"]])
            self.commanded_s = now_s

    def configure(self, wanted: dict[str, Any]) -> None:
        for key in ("damping", "force_gate"):
            self.config["filters"].update({key: wanted[key]} if key in wanted else {})
        self.config.update({key: wanted[key] for key in ("basis",) if key in wanted})
        if "preset" in wanted:
            self.config["mount"] = copy.deepcopy(_IDENTITY)

    def tell(self, now_s: float, whole: bool) -> dict[str, Any]:
        state = {"cursor_position": xyz(*self.place(now_s)), "cursor_velocity": xyz(0.0, 0.0, 0.0)}
        state["current_cursor_force"] = xyz(*self.force_n.tolist())
        return {"state": state, "status": self.status} | ({"config": self.config} if whole else {})


class _Peer:
    """A connection: HTTP for one request, or a WebSocket."""

    def __init__(self, wire: socket.socket) -> None:
        self.wire = wire
        wire.setblocking(False)
        wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.web = ServerProtocol()
        self.is_open = True
        self._began = b""
        self._is_web = False
        self.late: list[tuple[float, bytes]] = []  # answers that are held back, and until when

    def hear(self) -> tuple[list[bytes], bytes]:
        """Return messages, and a complete HTTP request."""
        try:
            data = self.wire.recv(1 << 16)
        except BlockingIOError:
            return [], b""
        except OSError:
            data = b""
        if not data:
            self.drop()
            return [], b""
        if not self._is_web:
            self._began += data
            if self._began.startswith(b"POST"):
                return [], self._began if self._is_whole() else b""
            self._is_web, data = True, self._began
        self.web.receive_data(data)
        heard = []
        for event in self.web.events_received():
            if isinstance(event, Request):
                self.web.send_response(self.web.accept(event))
                heard.append(b"")  # it begins
            elif event.opcode is Opcode.TEXT:
                heard.append(bytes(event.data))
        self.flush()
        return heard, b""

    def _is_whole(self) -> bool:
        head, found, body = self._began.partition(b"\r\n\r\n")
        lengths = [line for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:")]
        return bool(found) and len(body) >= int(lengths[0].split(b":")[1])

    def say(self, message: bytes) -> None:
        self.web.send_text(message)
        self.flush()

    def flush(self) -> None:
        try:
            for data in self.web.data_to_send():
                self.wire.sendall(data)
        except OSError:
            self.drop()

    def drop(self) -> None:
        self.is_open = False
        self.wire.close()


class HaplyService:
    """The service, and what it is told to do wrong.

    Attributes
    ----------
    arms, grips
        By identity; a grip is its state and status.
    spoil
        Changes an answer before it is sent; None for no answer at all.
    after_s
        How long answers take.
    held_back
        While true, messages are neither read nor answered.
    is_old
        Whether its inventory is that of 3.4.
    forces
        For every turn the force of every arm, in the service's axes.
    """

    def __init__(self, port: int = 0, **kinds: str) -> None:
        self.arms = {name: StandInArm(kind) for name, kind in (kinds or {"049D": "inverse3"}).items()}
        self.grips: dict[str, dict[str, Any]] = {}
        self.spoil: Callable[[Answer], bytes | None] = self.spoil_nothing
        self.after_s = 0.0
        self.held_back = self.is_old = False
        self.http_status = 200
        self.forces: list[np.ndarray] = []
        self.answered = 0
        self._lock = Lock()
        self._peers: list[_Peer] = []
        self._door = socket.create_server(("127.0.0.1", port))
        self._door.setblocking(False)
        self.port = self._door.getsockname()[1]
        self.clock = SteppedClock(self.turn)

    @staticmethod
    def spoil_nothing(answer: Answer) -> bytes:
        """Return an answer as it is."""
        return json.dumps(answer).encode()

    def close(self) -> None:
        """Be gone."""
        self._door.close()
        for peer in self._peers:
            peer.drop()
        self._peers = []
        for arm in self.arms.values():
            arm.force_n = np.zeros(3)

    def come_back(self) -> None:
        """Serve again at the same port, with arms as they were found."""
        self._door = socket.create_server(("127.0.0.1", self.port))
        self._door.setblocking(False)

    def turn(self, now_s: float) -> None:
        """Do what is due; without waiting. An arm is opened anew in a thread of its own, in the same time."""
        with self._lock:
            self._turn(now_s)

    def _turn(self, now_s: float) -> None:
        if not self.held_back:
            self._accept()
            for peer in list(self._peers):
                self._serve(peer, now_s)
        for arm in self.arms.values():
            bears = arm.plugged and arm.status["power_supply"] and arm.status["ready"]
            if now_s - arm.commanded_s > IDLE_S or not bears:
                arm.force_n = np.zeros(3)
        self._peers = [peer for peer in self._peers if peer.is_open]
        self.forces.append(np.array([arm.force_n for arm in self.arms.values()]))

    def wait(self, patience_s: float) -> None:
        """Wait until somebody says something."""
        select.select([self._door, *(peer.wire for peer in self._peers)], [], [], patience_s)

    def force_n(self, name: str) -> float:
        return float(np.linalg.norm(self.arms[name].force_n))

    def _accept(self) -> None:
        try:
            self._peers.append(_Peer(self._door.accept()[0]))
        except OSError:
            return

    def _serve(self, peer: _Peer, now_s: float) -> None:
        messages, request = peer.hear()
        if request:
            self._obey_http(peer, request)
        for message in messages:
            whole = not message
            if message:
                whole = self._obey(json.loads(message), now_s)
            answer = self._tell(now_s, whole)
            if not message and not self.is_old:
                answer["session_id"] = 7
            said = self.spoil(answer)
            if said is not None:
                peer.late.append((now_s + self.after_s, said))
        while peer.late and peer.late[0][0] <= now_s and peer.is_open:
            peer.say(peer.late.pop(0)[1])
            self.answered += 1

    def _obey(self, message: Answer, now_s: float) -> bool:
        for entries in (message.get("inverse3", []), message.get("minverse", [])):
            for entry in entries:
                arm = self.arms.get(entry["device_id"])
                if arm is not None and arm.plugged:
                    arm.configure(entry.get("configure", {}))
                    arm.command(entry.get("commands", {}), now_s)
        return "force_render_full_state" in message.get("session", {})

    def _obey_http(self, peer: _Peer, request: bytes) -> None:
        head, _, body = request.partition(b"\r\n\r\n")
        _, key, name, _, setting = head.split(b" ")[1].decode().split("/")
        arm = self.arms.get(name)
        if arm is not None and self.http_status == 200:
            arm.config[setting] = json.loads(body)
        peer.wire.sendall(f"HTTP/1.1 {self.http_status} {key}\r\nContent-Length: 2\r\n\r\n{{}}".encode())
        peer.drop()

    def _tell(self, now_s: float, whole: bool) -> Answer:
        told: Answer = {}
        for name, arm in self.arms.items():
            if arm.plugged:
                key = "minverse" if arm.config["type"] == "minverse" else "inverse3"
                told.setdefault(key, []).append({"device_id": name} | arm.tell(now_s, whole))
        if self.grips:
            told["wireless_verse_grip"] = [{"device_id": name} | grip for name, grip in self.grips.items()]
        return told


def to_and_fro(now_s: float) -> tuple[float, float, float]:
    """Return where a hand is that moves slowly about the middle."""
    return (CENTRE_M[0], CENTRE_M[1], CENTRE_M[2] + 0.02 * math.sin(now_s))


def main(port: int) -> None:
    """Serve two arms that rest, tell the port, and obey the lines of the standard input until it ends."""
    with contextlib.suppress(OSError):  # a busy host would let it wait for longer than a service of a real host
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))
    service = HaplyService(port, LEFT="inverse3", RIGHT="inverse3")
    print(service.port, flush=True)
    inbox = os.fdopen(os.dup(0), "rb", buffering=0)
    while True:
        if select.select([inbox], [], [], 0.0)[0]:
            line = inbox.read(1 << 12).decode()
            if not line:
                break
            for order in line.splitlines():
                _obey(service, *order.split())
        if service.held_back:
            time.sleep(1e-3)
        else:
            service.wait(1e-3)
        service.turn(time.monotonic())
    print(json.dumps(np.array(service.forces).tolist()), flush=True)


def _obey(service: HaplyService, what: str, value: str) -> None:
    match what:
        case "plug":
            service.arms["LEFT"].plugged = bool(int(value))
        case "hold":
            service.held_back = bool(int(value))
        case "spoil":
            service.spoil = (lambda _: b'{"inverse3": [{"device_id": 49}]}') if int(value) else service.spoil_nothing


if __name__ == "__main__":
    main(int(sys.argv[1]))
