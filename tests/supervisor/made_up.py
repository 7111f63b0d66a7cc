"""Health bodies with counts of one's choice, and a supervisor on the memory bus whose clock the test holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import trocar.protocol.bodies as bodies
from tests.memory_bus import MemoryBus, MemoryHub
from tests.protocol import samples
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.measures.histogram import LatencyHistogram
from trocar.services.supervisor.control.supervisor import Setup, Supervisor
from trocar.services.supervisor.crew.processes import TABLE, ProcessSpec
from trocar.services.supervisor.judge.governor import Level
from trocar.services.supervisor.page.dashboard import DashboardSnapshot, Heard, snapshot

MS = 1_000_000


def histogram(durations_ns: Iterable[int], deadline_ns: int = MS) -> bodies.Histogram:
    made = LatencyHistogram(deadline_ns)
    for duration in durations_ns:
        made.record(duration)
    return made.body()


def weighed(durations_ns: dict[int, int], deadline_ns: int = MS) -> bodies.Histogram:
    """Return the histogram of each duration counted so many times, without recording them one by one."""
    whole = LatencyHistogram(deadline_ns)
    for duration, count in durations_ns.items():
        one = LatencyHistogram(deadline_ns)
        one.record(duration)
        whole.counts += one.counts * count
        whole.sum_ns += duration * count
        whole.max_ns = max(whole.max_ns, duration if count else 0)
    return whole.body()


def loop_report(
    ticks: int,
    misses: int = 0,
    skipped: int = 0,
    rate_hz: float = 1000.0,
    stalls: tuple[bodies.Stall, ...] = (),
    beyond_work: int = 0,
) -> bodies.LoopReport:
    late = misses - skipped
    body = weighed({100_000: ticks - late, 2 * MS: late})
    return bodies.LoopReport(
        rate_hz=rate_hz,
        ticks=ticks,
        misses=misses,
        skipped=skipped,
        lateness=body,
        work=body,
        period=body,
        stalls=stalls,
        beyond_work=beyond_work,
    )


def health(
    process: str,
    *,
    uptime_s: float = 1.0,
    state: str = "ready",
    pid: int = 7,
    loop: bodies.LoopReport | None = None,
    paths: tuple[bodies.PathLatency, ...] = (),
    topics: tuple[bodies.TopicReport, ...] = (),
    gauges: dict[str, float] | None = None,
    detail: str = "",
) -> bodies.Health:
    return bodies.Health(
        process=process, pid=pid, state=state, uptime_s=uptime_s, loop=loop, paths=paths, topics=topics,
        gauges=gauges or {}, detail=detail,
    )  # fmt: skip


STREAMS: dict[str, Callable[[int], object]] = {
    "gateway.state": lambda tick: bodies.GatewayState(tick=tick),
    "haptics.contact_model": lambda tick: bodies.ContactModel.of(tick, 0.02, ()),
    "physics.state": samples.physics_state,
}


@dataclass
class Peer:
    """A process that exists on the memory bus only."""

    spec: ProcessSpec
    bus: MemoryBus
    pid: int = 100
    alive: bool = True
    state: str = "ready"
    born_s: float = 0.0
    ticks: int = 0
    misses: int = 0
    miss_ratio: float = 0.0
    next_health_s: float = 0.0
    stalls: tuple[bodies.Stall, ...] = ()
    detail: str = ""
    gauges: dict[str, float] = field(default_factory=dict)

    def turn(self, now_s: float, dt_s: float) -> None:
        if not self.alive:
            return
        due = round(1000 * dt_s)
        late = round(due * self.miss_ratio)
        self.ticks, self.misses = self.ticks + due, self.misses + late
        if self.spec.stream is not None:
            self.bus.publish(self.spec.stream, STREAMS[self.spec.stream](self.ticks))  # type: ignore[arg-type]
        if now_s >= self.next_health_s:
            self.next_health_s = now_s + 0.1
            body = health(
                self.spec.name,
                uptime_s=now_s - self.born_s,
                state=self.state,
                pid=self.pid,
                loop=loop_report(self.ticks, self.misses, stalls=self.stalls),
                detail=self.detail,
                gauges=dict(self.gauges),
            )
            self.bus.publish(f"{self.spec.name}.health", body)

    def reborn(self, now_s: float) -> None:
        self.pid, self.alive, self.born_s, self.ticks, self.misses = self.pid + 1, True, now_s, 0, 0


@dataclass
class Bench:
    """A supervisor in attach mode, its peers, and a clock."""

    rig: Rig
    levels: int | tuple[Level, ...] = 1
    memory: Path | None = None
    now_s: float = 1000.0
    peers: dict[str, Peer] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.hub = hub = MemoryHub()
        for spec in TABLE:
            more = ["training.attempt"] if spec.name == "training" else [spec.stream] if spec.stream else []
            publishes = [f"{spec.name}.health", *more]
            self.peers[spec.name] = Peer(spec, MemoryBus(hub, publishes=publishes), born_s=self.now_s)
        reads = [f"{spec.name}.health" for spec in TABLE] + [spec.stream for spec in TABLE if spec.stream]
        bus = MemoryBus(hub, publishes=["supervisor.state", "supervisor.judgement"], reads=[*reads, "training.attempt"])
        self.ears = MemoryBus(hub, reads_every=["supervisor.state"])
        levels = self.levels
        if isinstance(levels, int):
            levels = tuple(Level(str(k)) for k in range(levels))
        setup = Setup(self.rig, TABLE, None, levels, self.memory)
        self.supervisor = Supervisor(setup, bus, self.now_s)
        self.heard = {name: Heard(2.0) for name in self.peers}
        self.supervisor.crew.on_report = lambda name, body: self.heard[name].take_report(body)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False, turn_s: float = 0.02) -> float:
        """Let time pass in turns of a session; return how much passed before `until`."""
        for turn in range(math.ceil(round(seconds / turn_s, 6))):
            if until():
                return turn * turn_s
            self.now_s += turn_s
            for peer in self.peers.values():
                peer.turn(self.now_s, turn_s)
            self.supervisor.step(self.now_s)
        return seconds

    def told(self) -> list[bodies.SupervisorState]:
        """Return what the supervisor published since the last call."""
        frames: list[bodies.SupervisorState] = []
        while got := self.ears.drain("supervisor.state"):
            frames += [frame.body for frame in got]
        return frames


def rig(**settings: object) -> Rig:
    return Rig.model_validate({"name": "made up", "supervisor": {"mode": "attach"}, **settings})


def shown(bench: Bench) -> DashboardSnapshot:
    """Return what the page would show."""
    supervisor = bench.supervisor
    return snapshot(supervisor.body(), supervisor.judgement(), bench.heard, supervisor.rig, "default")
