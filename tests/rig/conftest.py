"""A whole rig, launched as a user would, and an observer on its bus."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tests.ports import free_port
from tests.with_us import with_us
from trocar.protocol.bodies import GatewayState, PhysicsState, SupervisorState
from trocar.services.runtime.bus.endpoints import lock_holders
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport

HERE = Path(__file__).parent
SCENE = HERE.parent / "scenes" / "small.yaml"
START_S = 400.0  # compiling every kernel on a busy machine: at a load of 16 it took three minutes


@dataclass
class Sample:
    """The first instrument at one tick."""

    sent_ns: int
    sampled_ns: int
    incarnation: int
    tick: int
    force_n: tuple[float, float, float]
    state: str
    model_age_s: float
    begins: int = 0
    hip_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fault: str = ""


@dataclass
class Observer:
    """Everything that the gateway and the supervisor said."""

    bus: ZmqBus
    samples: list[Sample] = field(default_factory=list)
    states: list[tuple[int, SupervisorState]] = field(default_factory=list)
    devices: list[GatewayState] | None = None  # kept for who wants them, as what physics said
    solved: list[PhysicsState] | None = None

    def look(self) -> None:
        for frame in self.bus.drain("gateway.state"):
            body: GatewayState = frame.body
            if self.devices is not None:
                self.devices.append(body)
            left = body.instruments[0]
            times_ns = frame.sent_ns, frame.origin_ns
            felt = left.applied_force_n, left.state, left.model_age_s, body.begins, left.position_m, left.fault
            self.samples.append(Sample(*times_ns, frame.incarnation, body.tick, *felt))
        if self.solved is not None:
            self.solved.extend(frame.body for frame in self.bus.drain("physics.state"))
        self.states.extend((frame.sent_ns, frame.body) for frame in self.bus.drain("supervisor.state"))

    def until(self, condition: Callable[[], bool], seconds: float, what: str) -> None:
        """Look until `condition` holds."""
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, f"not within {seconds} s: {what}; last: {self._last()}"
            time.sleep(0.005)
            self.look()

    def _last(self) -> str:
        return f"{self.samples[-1:]}, {self.states[-1:]}"

    @property
    def rig_state(self) -> str:
        return self.states[-1][1].state if self.states else "unknown"

    @property
    def has_started(self) -> bool:
        """Whether all processes are there; a second later, if all goes well, the rig is running."""
        return self.is_up or self.rig_state == "ready"

    @property
    def is_up(self) -> bool:
        """Whether all processes are there, be some of them late: a slow machine can give no more."""
        return self.rig_state in ("running", "degraded")

    def pids(self) -> dict[str, int]:
        return {p.name: p.pid for p in self.states[-1][1].processes}

    def report(self, name: str) -> str:
        return next(p.state for p in self.states[-1][1].processes if p.name == name)


@dataclass
class Rig:
    """A launched rig."""

    directory: Path
    process: subprocess.Popen[bytes]
    observer: Observer


def end(process: subprocess.Popen[bytes], directory: Path) -> None:
    """End a rig, also where a test has ended or stopped its supervisor."""
    process.send_signal(signal.SIGCONT)
    process.send_signal(signal.SIGINT)
    try:
        process.wait(60)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    for pid in lock_holders(Transport(directory=directory / "bus")).values():  # left over
        os.kill(pid, signal.SIGKILL)


@contextmanager
def running_rig(
    directory: Path,
    scene: str,
    overrides: list[str],
    topics: tuple[str, ...] = (),
    *,
    keeps_solved: bool = False,
    rig: str = "stub",
    program: tuple[str, ...] = ("-m", "trocar.services.supervisor"),
) -> Iterator[Rig]:
    """Launch a rig in `directory`; yield it once it has started. It is not restarted if slow: the machine may be.

    Its observer may read more `topics` whole, or keep all that gateway and physics say.
    """
    bus = directory / "bus"
    overrides = [
        f"transport.directory={bus}",
        f"recorder.directory={directory / 'recordings'}",
        f"supervisor.web.port={free_port()}",
        f"visualization.port={free_port()}",
        *(f"contracts.loops.{loop}.stop_miss_ratio=1" for loop in ("gateway", "haptics", "physics")),
        *overrides,
    ]
    options = [word for override in overrides for word in ("--set", override)]
    log = (directory / "log").open("wb")
    process = subprocess.Popen(
        with_us([sys.executable, *program, "--rig", rig, "--scene", scene, *options]),
        stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    read = ["gateway.state", "supervisor.state", *topics, *(["physics.state"] if keeps_solved else [])]
    observer = Observer(ZmqBus(Transport(directory=bus), reads_every=read))
    if keeps_solved:
        observer.devices, observer.solved = [], []
    try:
        observer.until(lambda: observer.has_started or process.poll() is not None, START_S, "run")
        assert process.poll() is None, (directory / "log").read_text()[-3000:]
        yield Rig(directory, process, observer)
    finally:
        end(process, directory)
        observer.bus.close()
        log.close()
