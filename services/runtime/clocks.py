"""Clocks of other hosts: what theirs is ahead of ours, by round trips, between two bounds that hold it for certain.

A monotonic clock begins with its host's boot: those of two are never compared. Each process asks the publishers that it
hears from other hosts for their time. The answer was made after the question left and before it came: these are the
bounds, whichever way took how long. The best trip holds, widened by what clocks drift since.
"""

from __future__ import annotations

import hashlib
import os
import struct
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import zmq

from services.runtime.endpoints import endpoint
from services.runtime.frame_batches import is_readable
from services.runtime.keys import ZapAuthenticator
from services.runtime.rig import LOOPBACK, Transport

#: Two clocks that NTP slews, each by up to 500 ppm, drift apart so fast at most.
DRIFT = 1e-3
_ASK_EVERY_NS = 100_000_000
_ANSWER = struct.Struct("<qq16s")  # asked_ns as it came, told_ns, whose clock
_ANSWERS = 16
#: What tells the clock of this process from all others: the host's boot, and the time namespace.
_OURS = hashlib.blake2b(Path("/proc/sys/kernel/random/boot_id").read_bytes(), digest_size=16)
with suppress(FileNotFoundError):
    _OURS.update(os.readlink("/proc/self/ns/time").encode())
_WHOSE = _OURS.digest()


class ClockOffset:
    """How far the clock of another host is ahead of ours."""

    def __init__(self) -> None:
        self._low_ns = self._high_ns = self._at_ns = 0
        self.known = self.ours = False

    def take(self, asked_ns: int, told_ns: int, heard_ns: int) -> None:
        """Take an answer: they had `told_ns` between our `asked_ns` and `heard_ns`."""
        low_ns, high_ns = told_ns - heard_ns, told_ns - asked_ns + round(DRIFT * (heard_ns - asked_ns))
        if self.known:
            drift_ns = round(DRIFT * (heard_ns - self._at_ns))
            best = max(low_ns, self._low_ns - drift_ns), min(high_ns, self._high_ns + drift_ns)
            if best[0] <= best[1]:  # else it is another clock now: its host has booted
                low_ns, high_ns = best
        self._low_ns, self._high_ns, self._at_ns, self.known = low_ns, high_ns, heard_ns, True

    def hear(self, answer: bytes, heard_ns: int) -> None:
        """Take an answer as it came; what is none is nothing."""
        if len(answer) == _ANSWER.size:
            asked_ns, told_ns, whose = _ANSWER.unpack(answer)
            self.ours = whose == _WHOSE
            if 0 < asked_ns <= heard_ns:
                self.take(asked_ns, told_ns, heard_ns)

    @property
    def ahead_ns(self) -> int:
        """By how much it is ahead: the middle of what may be."""
        return 0 if self.ours else (self._low_ns + self._high_ns) // 2

    def here_ns(self, there_ns: int) -> int:
        """Return what our clock has when theirs has `there_ns`; never less than 1."""
        return max(1, there_ns - self.ahead_ns)

    def uncertainty_ns(self, now_ns: int) -> int:
        """Return how far `here_ns` may be off."""
        return 0 if self.ours else (self._high_ns - self._low_ns + 1) // 2 + round(DRIFT * (now_ns - self._at_ns))


class Clocks:
    """The clocks of `publishers` on other hosts, and answers to who asks for that of `process`, if it has a name."""

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        transport: Transport,
        doorkeeper: ZapAuthenticator | None,
        process: str,
        publishers: Iterable[str],
    ) -> None:
        self.offsets: dict[str, ClockOffset] = {}
        self._asking: dict[str, zmq.Socket[bytes]] = {}
        self._answering: zmq.Socket[bytes] | None = None
        self._due_ns = 0
        if transport.kind != "tcp":
            return
        if process and transport.bind_host not in LOOPBACK:
            self._answering = _socket(context, zmq.ROUTER)
            if doorkeeper:
                doorkeeper.guard_publisher(self._answering)
            self._answering.bind(endpoint(transport, f"{process}.clock", transport.bind_host))
        for name in publishers:
            if transport.address(name) not in LOOPBACK and not transport.shares_host(process, name):
                self._asking[name] = asking = _socket(context, zmq.DEALER)
                asking.setsockopt(zmq.IMMEDIATE, 1)  # a question does not wait for who is not there
                where = endpoint(transport, f"{name}.clock")
                if doorkeeper:
                    doorkeeper.guard_reader(asking, where)
                asking.connect(where)
                self.offsets[name] = ClockOffset()

    def turn(self) -> None:
        """Answer who asks, ask, and take answers. Never blocks; on one host there is nothing to do."""
        if self._answering is None and not self._asking:
            return
        self._answer()
        now_ns = time.monotonic_ns()
        asks = now_ns >= self._due_ns
        for name, socket in self._asking.items():
            offset = self.offsets[name]
            if is_readable(socket):
                offset.hear(socket.recv(), time.monotonic_ns())
            if asks and not offset.ours:
                with suppress(zmq.Again):
                    socket.send(time.monotonic_ns().to_bytes(8, "little"), zmq.NOBLOCK)
        self._due_ns = now_ns + _ASK_EVERY_NS if asks else self._due_ns

    def gauges(self) -> dict[str, float]:
        """Return by how much each clock is ahead, and by how much that may be off, in s: of those that are known."""
        now_ns = time.monotonic_ns()
        known = {name: offset for name, offset in self.offsets.items() if offset.known}
        ahead = {f"clock_ahead_s.{name}": 1e-9 * each.ahead_ns for name, each in known.items()}
        return ahead | {f"clock_off_s.{name}": 1e-9 * each.uncertainty_ns(now_ns) for name, each in known.items()}

    def _answer(self) -> None:
        for _ in range(_ANSWERS):
            if self._answering is None or not is_readable(self._answering):
                return
            who, *asked = self._answering.recv_multipart()
            if list(map(len, asked)) == [8]:
                told = time.monotonic_ns().to_bytes(8, "little")
                self._answering.send_multipart([who, asked[0] + told + _WHOSE], zmq.NOBLOCK)


def _socket(context: zmq.Context[zmq.Socket[bytes]], kind: int) -> zmq.Socket[bytes]:
    socket = context.socket(kind)
    socket.setsockopt(zmq.MAXMSGSIZE, 1024)
    socket.sndhwm = socket.rcvhwm = _ANSWERS
    return socket
