"""Clocks of other hosts: their offset from ours with certain bounds, measured by round trips.

A monotonic clock begins with its host's boot, so two of them cannot be compared. Each process requests the time of the
publishers on other hosts that it reads. The answer was made after the request left and before it arrived; these are the
bounds, however long each way took. The best round trip is used, widened by the drift since.
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

from trocar.services.runtime.bus.endpoints import endpoint
from trocar.services.runtime.bus.frame_batches import is_readable
from trocar.services.runtime.bus.keys import ZapAuthenticator
from trocar.services.runtime.config.rig import LOOPBACK, Transport

#: Largest relative drift of two clocks slewed by NTP, each by up to 500 ppm.
DRIFT = 1e-3
#: Meanwhile two clocks drift apart by at most `DRIFT` of it, 0.1 ms: a tenth of a tick.
_ASK_EVERY_NS = 100_000_000
_ANSWER = struct.Struct("<qq16s")  # asked_ns as it came, told_ns, whose clock
#: Of one call, so that a flood of questions does not hold a loop; a rig's six processes ask ten times a second.
_ANSWERS = 16
#: Identity of this process' clock: the host's boot, and the time namespace.
_OURS = hashlib.blake2b(Path("/proc/sys/kernel/random/boot_id").read_bytes(), digest_size=16)
with suppress(FileNotFoundError):
    _OURS.update(os.readlink("/proc/self/ns/time").encode())
OWN_CLOCK = _OURS.digest()


class ClockOffset:
    """Offset of another host's clock from ours."""

    def __init__(self) -> None:
        self._low_ns = self._high_ns = self._at_ns = 0
        self.known = self.ours = False

    def take_answer(self, asked_ns: int, told_ns: int, heard_ns: int) -> None:
        """Process an answer: their clock was at `told_ns` between our `asked_ns` and `heard_ns`."""
        low_ns, high_ns = told_ns - heard_ns, told_ns - asked_ns + round(DRIFT * (heard_ns - asked_ns))
        if self.known:
            drift_ns = round(DRIFT * (heard_ns - self._at_ns))
            best = max(low_ns, self._low_ns - drift_ns), min(high_ns, self._high_ns + drift_ns)
            if best[0] <= best[1]:  # otherwise it is another clock, as its host has rebooted
                low_ns, high_ns = best
        self._low_ns, self._high_ns, self._at_ns, self.known = low_ns, high_ns, heard_ns, True

    def hear_answer(self, answer: bytes, heard_ns: int) -> None:
        """Process a received answer; invalid ones are ignored."""
        if len(answer) == _ANSWER.size:
            asked_ns, told_ns, whose = _ANSWER.unpack(answer)
            self.ours = whose == OWN_CLOCK
            if 0 < asked_ns <= heard_ns:
                self.take_answer(asked_ns, told_ns, heard_ns)

    @property
    def ahead_ns(self) -> int:
        """Its offset: the middle between the bounds."""
        return 0 if self.ours else (self._low_ns + self._high_ns) // 2

    def here_ns(self, there_ns: int) -> int:
        """Return our time when theirs is `there_ns`, at least 1."""
        return max(1, there_ns - self.ahead_ns)

    def uncertainty_ns(self, now_ns: int) -> int:
        """Return the largest error of `here_ns`."""
        return 0 if self.ours else (self._high_ns - self._low_ns + 1) // 2 + round(DRIFT * (now_ns - self._at_ns))


class Clocks:
    """The clocks of `publishers` on other hosts, and answers to requests for that of `process`, if it has a name."""

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
                asking.setsockopt(zmq.IMMEDIATE, 1)  # requests to absent peers are not queued
                where = endpoint(transport, f"{name}.clock")
                if doorkeeper:
                    doorkeeper.guard_reader(asking, where)
                asking.connect(where)
                self.offsets[name] = ClockOffset()

    def exchange_times(self) -> None:
        """Answer requests, send requests, and process answers. Never blocks; does nothing on a single host."""
        if self._answering is None and not self._asking:
            return
        self._answer()
        now_ns = time.monotonic_ns()
        asks = now_ns >= self._due_ns
        for name, socket in self._asking.items():
            offset = self.offsets[name]
            if is_readable(socket):
                offset.hear_answer(socket.recv(), time.monotonic_ns())
            if asks and not offset.ours:
                with suppress(zmq.Again):
                    socket.send(time.monotonic_ns().to_bytes(8, "little"), zmq.NOBLOCK)
        self._due_ns = now_ns + _ASK_EVERY_NS if asks else self._due_ns

    def gauges(self) -> dict[str, float]:
        """Return offset and uncertainty, in s, of each known clock."""
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
                self._answering.send_multipart([who, asked[0] + told + OWN_CLOCK], zmq.NOBLOCK)


def _socket(context: zmq.Context[zmq.Socket[bytes]], kind: int) -> zmq.Socket[bytes]:
    socket = context.socket(kind)
    socket.setsockopt(zmq.MAXMSGSIZE, 1024)
    socket.sndhwm = socket.rcvhwm = _ANSWERS
    return socket
