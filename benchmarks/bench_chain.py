"""How near the chain gateway, haptics, physics is to the smallest ZeroMQ program that passes the same frames on.

    python benchmarks/bench_chain.py [--seconds 20] [--runs 3]

Three processes with the cores, priorities and frame sizes of the rig and no work at all: the first sends a frame each
millisecond, the second answers it and sends another on, the third answers with the large one. Variants, interleaved,
change one thing each: whether the processes speak ZeroMQ's protocol themselves, as the rig's loops do, or leave it to
libzmq's thread; the priority of that thread, the cores, whether the first waits for its answer. Times are from the
sample to where the frame is in the hands of the process that is named.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
import zmq
from report import Row, write_report
from rig_threads import watch

from trocar.services.runtime.bus.direct import DirectReader, DirectSender
from trocar.services.runtime.bus.frame_batches import is_readable
from trocar.services.runtime.realtime import realtime

PERIOD_NS = 1_000_000
#: Bytes of gateway.state, haptics.contact_model, haptics.contacts and physics.state in the default scene, touching.
DEVICE, MODEL, CONTACTS, STATE = 520, 660, 810, 5470
_WAIT_MS = 2


@dataclass(frozen=True)
class Variant:
    """How the three are laid out."""

    cores: tuple[int, int, int] = (0, 0, 1)
    priorities: tuple[int, int, int] = (80, 70, 60)
    bus_above: bool = False
    waits: bool = False
    at_once: bool = True
    direct: bool = False


BASE = Variant()
VARIANTS = {
    "as the rig": replace(BASE, direct=True),
    "as the rig, the gateway waits": replace(BASE, direct=True, waits=True),
    "libzmq": BASE,
    "all on one core": replace(BASE, cores=(0, 0, 0)),
    "haptics on physics' core": replace(BASE, cores=(0, 1, 1)),
    "equal priorities": replace(BASE, priorities=(60, 60, 60)),
    "bus thread one above": replace(BASE, bus_above=True),
    "the model leaves when haptics sleeps": replace(BASE, at_once=False),
    "the gateway waits for its model": replace(BASE, waits=True),
}


class Peer:
    """Sockets of one of the three, real-time as the rig's processes are."""

    def __init__(self, directory: Path, variant: Variant, place: int) -> None:
        core, priority = variant.cores[place], variant.priorities[place]
        above = priority + variant.bus_above
        realtime.set_up(core, above)
        self._directory = directory
        self._direct = variant.direct
        self._context = zmq.Context()
        self._context.linger = 0
        self._context.socket(zmq.PUB).bind("inproc://start")  # starts the bus' thread, which keeps the priority
        realtime.set_up(core, priority)
        gc.collect()
        gc.disable()

    def sender(self, name: str) -> zmq.Socket[bytes] | DirectSender:
        """Return a bound socket."""
        if self._direct:
            return DirectSender(str(self._directory / name))
        socket = self._context.socket(zmq.PUB)
        socket.bind(f"ipc://{self._directory / name}")
        return socket

    def reader(self, name: str) -> Reader:
        """Return a socket that keeps the newest frame."""
        if self._direct:
            return Direct(str(self._directory / name))
        socket = self._context.socket(zmq.SUB)
        socket.conflate = True
        socket.connect(f"ipc://{self._directory / name}")
        socket.setsockopt(zmq.SUBSCRIBE, b"")
        return Libzmq(socket)


class Reader(Protocol):
    """The newest frame, whoever brings it."""

    def newest(self) -> bytes | None:
        """Return the newest frame if there is one."""

    def poll(self, wait_ms: int) -> bool:
        """Wait for a frame."""


class Libzmq:
    """By libzmq's thread."""

    def __init__(self, socket: zmq.Socket[bytes]) -> None:
        self._socket = socket

    def newest(self) -> bytes | None:
        """Return the newest frame if there is one."""
        return self._socket.recv() if is_readable(self._socket) else None

    def poll(self, wait_ms: int) -> bool:
        """Wait for a frame."""
        return bool(self._socket.poll(wait_ms))


class Direct(DirectReader):
    """By this process itself."""

    def poll(self, wait_ms: int) -> bool:
        """Wait for a frame."""
        return self.wait(time.monotonic_ns() + 1_000_000 * wait_ms)


def _stamped(sampled: bytes, size: int) -> bytes:
    return sampled.ljust(size, b"\0")


def _sampled_ns(frame: bytes) -> int:
    return int.from_bytes(frame[:8], "little")


def gateway(peer: Peer, variant: Variant, seconds: float) -> list[int]:
    """Send a frame a period; return how long after each its answer was found."""
    out, model = peer.sender("device"), peer.reader("model")
    taken: list[int] = []
    due_ns = time.monotonic_ns() + 500 * PERIOD_NS
    for tick in range(round(seconds * 1e9 / PERIOD_NS)):
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
        model.newest()
        out.send(_stamped(time.monotonic_ns().to_bytes(8, "little"), DEVICE))
        if (variant.waits or tick % 16 == 0) and model.poll(_WAIT_MS // 2) and (frame := model.newest()):
            taken.append(time.monotonic_ns() - _sampled_ns(frame))
        due_ns += PERIOD_NS
    return taken


def haptics(peer: Peer, variant: Variant, seconds: float) -> list[int]:
    """Answer each frame; return how long after the sample each was there."""
    device, state = peer.reader("device"), peer.reader("state")
    model, contacts = peer.sender("model"), peer.sender("contacts")
    there: list[int] = []
    end_ns = time.monotonic_ns() + round(seconds * 1e9) + 700 * PERIOD_NS
    while time.monotonic_ns() < end_ns:
        if not device.poll(_WAIT_MS) or (frame := device.newest()) is None:
            continue
        there.append(time.monotonic_ns() - _sampled_ns(frame))
        state.newest()
        model.send(_stamped(frame[:8], MODEL))
        if variant.at_once and not variant.direct:
            os.sched_yield()
        contacts.send(_stamped(frame[:8], CONTACTS))
    return there


def physics(peer: Peer, variant: Variant, seconds: float) -> list[int]:
    """Answer each frame of contacts; return how long after the sample each was there."""
    contacts, state = peer.reader("contacts"), peer.sender("state")
    there: list[int] = []
    end_ns = time.monotonic_ns() + round(seconds * 1e9) + 700 * PERIOD_NS
    while time.monotonic_ns() < end_ns:
        if contacts.poll(_WAIT_MS) and (frame := contacts.newest()) is not None:
            there.append(time.monotonic_ns() - _sampled_ns(frame))
            state.send(_stamped(frame[:8], STATE))
    return there


ROLES = (gateway, haptics, physics)


def run(name: str, seconds: float) -> dict[str, float]:
    """Run one variant; return medians and 99 % of each way in us, and what it costs."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(Path(__file__)), "--role"]
        peers = [
            subprocess.Popen([*command, str(place), folder, name, str(seconds)], stdout=subprocess.PIPE)
            for place in range(3)
        ]
        time.sleep(1.5)
        found: dict[str, float] = dict.fromkeys(("switches_per_s", "realtime_percent"), 0.0)
        for peer in peers:
            counts = watch(peer.pid, (seconds - 2.0) / 3.0)
            found = {key: found[key] + counts[key] for key in found}
        for role, peer in zip(ROLES, peers, strict=True):
            ways_us = np.array(json.loads(peer.communicate()[0])) / 1e3
            found[role.__name__], found[f"{role.__name__} p99"] = np.percentile(ways_us[100:], [50, 99]).tolist()
    return found


def rows_of(name: str, runs: list[dict[str, float]]) -> list[Row]:
    """Return the lines of one variant."""
    middle = {key: statistics.median(run[key] for run in runs) for key in runs[0]}
    labels = {"haptics": "frame at haptics", "gateway": "model at the gateway", "physics": "contacts at physics"}
    rows = [Row(f"{name}: {label}", middle[key], "us", p99=middle[f"{key} p99"]) for key, label in labels.items()]
    rows.append(Row(f"{name}: context switches", middle["switches_per_s"], "1/s"))
    return [*rows, Row(f"{name}: processor time", middle["realtime_percent"], "% of a core")]


def main() -> None:
    """Measure and write the table; or be one of the three."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--name", default="chain", help="of the table in benchmarks/results")
    parser.add_argument("--role", nargs=4, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.role:
        place, folder, name, seconds = arguments.role
        peer = Peer(Path(folder), VARIANTS[name], int(place))
        print(json.dumps(ROLES[int(place)](peer, VARIANTS[name], float(seconds))))
        return
    names = [name for _ in range(arguments.runs) for name in VARIANTS]
    runs = [(name, run(name, arguments.seconds)) for name in names]
    rows = [row for name in VARIANTS for row in rows_of(name, [found for other, found in runs if other == name])]
    notes = (
        f"{arguments.runs} runs of {arguments.seconds:g} s each, interleaved; medians over the runs. No work is done."
    )
    write_report(arguments.name, "The smallest chain", rows, notes)


if __name__ == "__main__":
    main()
