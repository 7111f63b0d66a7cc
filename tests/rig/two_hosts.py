"""Hosts on one machine: network namespaces with a slow road between them, each with a monotonic clock of its own."""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import trocar.protocol.bodies as bodies
from tests.patience import PATIENCE_S
from tests.ports import free_port
from tests.rig.conftest import SCENE, START_S, Observer
from tests.rig.faults import HARD
from tests.with_us import with_us
from trocar.services.runtime.bus import keys
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport

HERE = Path(__file__).parent
PORT = 23_000
#: The bench has the machine's own clock, as has who observes there; the others' uptimes differ by an hour each.
AHEAD_S = (0, 3600, 7200)
OURS = "supervisor"
PROCESSES = ("haptics", "physics", "gateway", "visualization", "recorder", "training", "supervisor")
_CLONE_NEWNET = 0x40000000


def may_be_had() -> str:
    """Return why there can be no hosts here, empty where there can."""
    if missing := [name for name in ("ip", "unshare", "cc") if shutil.which(name) is None]:
        return f"no {missing[0]} here"
    probe = ["unshare", "--net", "--time", "--monotonic", "1", "--fork", "test", "-w", "/dev/net/tun"]
    return "" if subprocess.run(probe, check=False, capture_output=True).returncode == 0 else "not root, or no tunnels"


class Hosts:
    """So many hosts, the k-th at 10.77.0.k (from 1)."""

    def __init__(self, folder: Path, count: int = 2) -> None:
        self._names = [f"trocar{os.getpid()}-{k}" for k in range(1, count + 1)]
        with ExitStack() as self._stack:
            self._build(folder)
            self._stack = self._stack.pop_all()  # what fails half way leaves nothing

    def _build(self, folder: Path) -> None:
        road = folder / "slow_road"
        subprocess.run(["cc", "-O2", "-o", road, HERE / "slow_road.c"], check=True)
        for name in self._names:
            subprocess.run(["ip", "netns", "add", name], check=True)
            self._stack.callback(subprocess.run, ["ip", "netns", "delete", name], check=False)
        command = with_us(["chrt", "--fifo", "50", str(road), *self._names])
        self._road = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        self._stack.enter_context(self._road)
        self._stack.callback(self._road.kill)
        assert self._road.stdout is not None
        assert self._road.stdout.readline() == "open\n"
        for k, name in enumerate(self._names):
            for row in ("link set lo up", "link set road up", f"addr add {address(k)}/24 dev road"):
                subprocess.run(["ip", "-n", name, *row.split()], check=True)

    def set(self, delay_ms: float, jitter_ms: float = 0.0, loss: float = 0.0) -> None:
        """Make every way so long, up to so much longer, and lose this share of the packets."""
        assert self._road.stdin is not None
        self._road.stdin.write(f"{round(1e3 * delay_ms)} {round(1e3 * jitter_ms)} {loss}\n")

    @contextmanager
    def inside(self, host: int) -> Iterator[None]:
        """Make sockets on a host, with this machine's clock."""
        with open("/proc/self/ns/net") as home, open(f"/var/run/netns/{self._names[host]}") as there:
            _enter(there.fileno())
            try:
                yield
            finally:
                _enter(home.fileno())

    def start(self, host: int, command: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
        """Start a command on a host, with that host's clock."""
        ahead_s = AHEAD_S[host]
        clock = ["unshare", "--time", "--monotonic", str(ahead_s), "--fork", "--kill-child=TERM"] if ahead_s else []
        words = with_us(["ip", "netns", "exec", self._names[host], *clock, *command])
        with log.open("ab") as sink:
            process = subprocess.Popen(words, stdout=sink, stderr=sink, start_new_session=True)
        self._stack.callback(_end, process)
        return process

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _value: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._stack.close()


def address(host: int) -> str:
    """Return the address of a host, counted from 0."""
    return f"10.77.0.{host + 1}"


def _enter(space: int) -> None:
    if ctypes.CDLL(None, use_errno=True).setns(space, _CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), "setns")


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGTERM)
    try:
        process.wait(20)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


class FarRig:
    """A rig whose processes are on several hosts, `where` by name, and an observer on the bench.

    Its left hand presses on the duct. Who is not in `where` is left out.
    """

    def __init__(self, folder: Path, hosts: Hosts, where: Mapping[str, int], overrides: Sequence[str] = ()) -> None:
        self.folder, self.hosts = folder, hosts
        self.keys = keys.make(folder / "keys").parent
        self._where = where
        arms = [f"gateway.instruments.{i}.arm.settings" for i in (0, 1)]
        presses = [f"{arm}.{setting}" for arm in arms for setting in (f"script={HERE / 'press.yaml'}", "pace=1.0")]
        left_out = [f"processes.{name}.enabled=false" for name in PROCESSES if name not in where]
        ports = [f"supervisor.web.port={free_port()}", f"visualization.port={free_port()}"]
        self._overrides = [*HARD, *presses, *left_out, *ports, *overrides]
        self.processes = {name: self.start(name) for name in where}
        self.healths: dict[str, bodies.Health] = {}
        with hosts.inside(0):
            self.observer = Observer(ZmqBus(self.transport(0), reads_every=["gateway.state", "supervisor.state"]))
            self._listener = ZmqBus(self.transport(0), reads=[f"{name}.health" for name in where if name != OURS])

    def transport(self, host: int) -> Transport:
        """Return how frames travel, as a host says it."""
        reached = {name: address(k) for name, k in self._where.items()}
        return Transport(
            kind="tcp", base_port=PORT, hosts=reached, host=address(1), bind_host=address(host), keys=self.keys
        )

    def start(self, name: str) -> subprocess.Popen[bytes]:
        """Start a process where it belongs."""
        host = self._where[name]
        directory = self.folder / f"host{host}"
        reached = ", ".join(f"{each}: {address(k)}" for each, k in self._where.items())
        settings = [
            "transport.kind=tcp", f"transport.base_port={PORT}", f"transport.hosts={{{reached}}}",
            f"transport.host={address(1)}", f"transport.bind_host={address(host)}", f"transport.keys={self.keys}",
            f"transport.directory={directory}", f"recorder.directory={directory}", "supervisor.mode=attach",
            *self._overrides,
        ]  # fmt: skip
        words = [word for setting in settings for word in ("--set", setting)]
        command = [sys.executable, "-m", f"trocar.services.{name}", "--rig", "stub", "--scene", str(SCENE), *words]
        return self.hosts.start(host, command, self.folder / f"{name}.log")

    def until_it_runs(self) -> None:
        """Wait for every process."""
        self.observer.until(lambda: self.ended() or self.observer.is_up, START_S, "the rig runs")
        assert not self.ended(), (self.folder / f"{self.ended()[0]}.log").read_text()[-2000:]

    def ended(self) -> list[str]:
        """Return who has ended."""
        return [name for name, process in self.processes.items() if process.poll() is not None]

    def look_for(self, seconds: float) -> None:
        """Observe for a while."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            time.sleep(0.01)
            self.observer.look()
            self._listen()

    def health_of(self, name: str) -> bodies.Health:
        """Return the next report of a process."""
        self.healths.pop(name, None)
        end_s = time.monotonic() + PATIENCE_S
        while name not in self.healths:
            assert time.monotonic() < end_s, f"{name} says nothing"
            self.look_for(0.02)
        return self.healths[name]

    def close(self) -> None:
        """Stop observing; the hosts end what they run."""
        self.observer.bus.close()
        self._listener.close()

    def _listen(self) -> None:
        for name in self._where:
            if name == OURS:
                continue
            if (frame := self._listener.latest(f"{name}.health")) is not None:
                self.healths[name] = frame.body
