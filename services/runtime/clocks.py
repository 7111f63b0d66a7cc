"""Clocks of other hosts: what theirs is ahead of ours, by round trips, between two bounds that hold it for certain.

A monotonic clock begins with its host's boot, so those of two hosts are never compared. Each process of a rig on
several hosts asks the publishers that it hears, ten times a second, for their time. The answer was made after the
question left and before it arrived: these are the bounds, whichever way took how long, and a slow network widens them.
The best of all trips holds, widened by what clocks may drift since. Who shares a host's clock says so: nothing is to be
estimated then.
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
from services.runtime.keys import Keys
from services.runtime.rig import LOOPBACK, Transport

#: Two clocks that NTP slews, each by up to 500 ppm, drift apart so fast at most.
DRIFT = 1e-3
_ASK_EVERY_NS = 100_000_000
_ANSWER = struct.Struct("<qq16s")  # asked_ns as it came, told_ns, whose clock
_ANSWERS = 16


def _whose() -> bytes:
    """Return what tells the clock of this process from all others: the host's boot, and the time namespace."""
    space = Path("/proc/self/ns/time")
    name = Path("/proc/sys/kernel/random/boot_id").read_text() + (os.readlink(space) if space.exists() else "")
    return hashlib.blake2b(name.encode(), digest_size=16).digest()


_OURS = _whose()


class ClockOffset:
    """How far the clock of another host is ahead of ours."""

    def __init__(self) -> None:
        self._low_ns = self._high_ns = self._at_ns = 0
        self.known = self.ours = False

    def take(self, asked_ns: int, told_ns: int, heard_ns: int) -> None:
        """Take an answer: they had `told_ns` between our `asked_ns` and `heard_ns`."""
        low_ns, high_ns = told_ns - heard_ns, told_ns - asked_ns
        if self.known:
            drift_ns = round(DRIFT * (heard_ns - self._at_ns))
            best = max(low_ns, self._low_ns - drift_ns), min(high_ns, self._high_ns + drift_ns)
            if best[0] <= best[1]:  # else it is another clock now: its host has booted
                low_ns, high_ns = best
        self._low_ns, self._high_ns, self._at_ns, self.known = low_ns, high_ns, heard_ns, True

    def here_ns(self, there_ns: int) -> int:
        """Return what our clock has when theirs has `there_ns`, in the middle of what may be; never less than 1."""
        return max(1, there_ns - (self._low_ns + self._high_ns) // 2)

    def uncertainty_ns(self, now_ns: int) -> int:
        """Return how far `here_ns` may be off."""
        return 0 if self.ours else (self._high_ns - self._low_ns + 1) // 2 + round(DRIFT * (now_ns - self._at_ns))


class Clocks:
    """The clocks of the publishers that a process hears from other hosts, and answers to who asks for its own.

    Parameters
    ----------
    process
        That answers; empty for one that only listens.
    publishers
        That are heard; of those on this host the clock is ours.
    """

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        transport: Transport,
        keys: Keys | None,
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
            if keys:
                keys.guard_publisher(self._answering)
            self._answering.bind(endpoint(transport, f"{process}.clock", transport.bind_host))
        for name in publishers:
            if transport.address(name) not in LOOPBACK and not transport.shares_host(process, name):
                self._asking[name] = asking = _socket(context, zmq.DEALER)
                asking.setsockopt(zmq.IMMEDIATE, 1)  # a question does not wait for who is not there
                if keys:
                    keys.guard_reader(asking)
                asking.connect(endpoint(transport, f"{name}.clock"))
                self.offsets[name] = ClockOffset()

    def turn(self) -> None:
        """Answer who asks, ask, and take answers. Never blocks."""
        if self._answering is not None:
            self._answer(self._answering)
        now_ns = time.monotonic_ns()
        asks = now_ns >= self._due_ns
        for name, socket in self._asking.items():
            offset = self.offsets[name]
            if is_readable(socket):
                self._take(socket.recv(), offset)
            if asks and not offset.ours:
                with suppress(zmq.Again):
                    socket.send(time.monotonic_ns().to_bytes(8, "little"), zmq.NOBLOCK)
        if asks:
            self._due_ns = now_ns + _ASK_EVERY_NS

    def gauges(self) -> dict[str, float]:
        """Return by how much each clock is ahead, and by how much that may be off, in s: of those that are known."""
        now_ns = time.monotonic_ns()
        known = {name: offset for name, offset in self.offsets.items() if offset.known}
        ahead = {f"clock_ahead_s.{name}": 1e-9 * (now_ns - offset.here_ns(now_ns)) for name, offset in known.items()}
        return ahead | {f"clock_off_s.{name}": 1e-9 * each.uncertainty_ns(now_ns) for name, each in known.items()}

    @staticmethod
    def _answer(socket: zmq.Socket[bytes]) -> None:
        for _ in range(_ANSWERS):
            if not is_readable(socket):
                return
            who, *asked = socket.recv_multipart()
            if len(asked) == 1 and len(asked[0]) == 8:
                told = time.monotonic_ns().to_bytes(8, "little")
                socket.send_multipart([who, asked[0] + told + _OURS], zmq.NOBLOCK)

    @staticmethod
    def _take(answer: bytes, offset: ClockOffset) -> None:
        heard_ns = time.monotonic_ns()
        if len(answer) != _ANSWER.size:
            return
        asked_ns, told_ns, whose = _ANSWER.unpack(answer)
        if whose == _OURS:
            offset.ours = True
            asked_ns = heard_ns = told_ns
        if 0 < asked_ns <= heard_ns:
            offset.take(asked_ns, told_ns, heard_ns)


def _socket(context: zmq.Context[zmq.Socket[bytes]], kind: int) -> zmq.Socket[bytes]:
    socket = context.socket(kind)
    socket.setsockopt(zmq.MAXMSGSIZE, 1024)
    socket.sndhwm = socket.rcvhwm = _ANSWERS
    return socket
