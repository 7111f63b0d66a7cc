"""Opening a process: options, configuration, real-time set-up, bus, signals; and one clear sentence when that fails."""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, fields
from types import FrameType
from typing import Any

from protocol.topics import observed_by, published_by, read_by, topic
from services import start_up
from services.runtime import config, endpoints, log, realtime
from services.runtime.errors import BusError, UserError
from services.runtime.flight import SUFFIX, FlightRing, flight_directory
from services.runtime.health import HealthReporter
from services.runtime.loop import LoopMeter
from services.runtime.reservation_keeper import ReservationKeeper
from services.runtime.rig import Rig
from services.runtime.scene_requirements import EVERYTHING, SceneRequirements, scene_requirements
from services.runtime.scheduling import Scheduling
from services.runtime.zmq_bus import ZmqBus


@dataclass(frozen=True, slots=True)
class Options:
    """What every process is told on its command line."""

    rig: str
    scene: str | None
    overrides: tuple[str, ...]
    prepare_only: bool = False


@dataclass(slots=True, kw_only=True)
class ProcessConfig:
    """What a process is to be."""

    name: str
    rig: Rig
    scene_name: str
    scene_overrides: tuple[str, ...]
    log: logging.Logger
    requirements: SceneRequirements = EVERYTHING
    prepare_only: bool = False


@dataclass(slots=True, kw_only=True)
class Process(ProcessConfig):
    """An open process. Ends through `stop`, never by exit inside a loop."""

    facts: list[realtime.Fact]
    bus: ZmqBus
    health: HealthReporter
    _scheduling: Scheduling | None = None
    _stopping: list[bool] = field(default_factory=lambda: [False])

    def stop(self) -> bool:
        """Return whether the process was asked to end."""
        return self._stopping[0]

    def ready(self, meter: LoopMeter | None = None, *, starts_others: bool = False) -> None:
        """Say that everything is built and warm; the loop begins now, and real time with it.

        With `starts_others`, processes that this one starts are ordinary, whatever it is itself.
        """
        self.health.meter = meter
        if meter is not None:
            self._share(meter.flight)
        if self._scheduling is not None:
            self._scheduling.resume(alone=starts_others, period_ns=meter.period_ns if meter is not None else 0)
            had = realtime.scheduling_fact(self._scheduling)
            if had not in self.facts:  # others have reserved since what it was promised
                _warn_of(had, self.log)
            self._tell(had)
            if meter is not None and self._scheduling.may_reserve:
                self.health.before = self._keep(ReservationKeeper(self._scheduling, meter, self.log))
        self.facts.extend((realtime.freeze_garbage_collector(), realtime.read_back()))
        self.health.realtime = self.facts
        self.health.change("ready")
        if not starts_others:  # who starts others speaks for them
            self.log.info("ready")

    def _keep(self, keeper: ReservationKeeper) -> Callable[[], None]:
        def keep() -> None:
            if keeper.keep() and self._scheduling is not None:
                self._tell(realtime.scheduling_fact(self._scheduling))
                self._tell(realtime.read_back())

        return keep

    def _tell(self, had: realtime.Fact) -> None:
        self.facts[:] = [had if fact.name == had.name else fact for fact in self.facts]

    def _share(self, ring: FlightRing) -> None:
        """Let others look at the last ticks; without that a rig runs as well."""
        try:
            directory = flight_directory(endpoints.run_directory(self.rig.transport))
            ring.share(directory / f"{self.name}{SUFFIX}")
        except (BusError, OSError) as error:
            self.log.warning("the last ticks cannot be looked at: %s", error)


def parse(process: str, arguments: Sequence[str] | None) -> Options:
    """Return the options of a process' command line.

    ``TROCAR_RIG``, ``TROCAR_SCENE`` and ``TROCAR_SET`` (overrides, separated by spaces) stand in for options that are
    not given: so one environment configures all containers of a rig.
    """
    environment = os.environ
    parser = argparse.ArgumentParser(prog=f"python -m services.{process}")
    parser.add_argument(
        "--rig", default=environment.get("TROCAR_RIG") or "stub", help="rig file, or one's name in configs/rigs"
    )
    parser.add_argument(
        "--scene", default=environment.get("TROCAR_SCENE") or None, help="scene file, or one's name in configs/scenes"
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    parser.add_argument(
        "--prepare-only", action="store_true", help="build bases, compile kernels and end, as for an image"
    )
    parsed = parser.parse_args(arguments)
    overrides = (*environment.get("TROCAR_SET", "").split(), *parsed.overrides)
    return Options(parsed.rig, parsed.scene, overrides, parsed.prepare_only)


def load_process_config(name: str, options: Options) -> ProcessConfig:
    """Return what a process is to be, before anything of it is real-time or on the bus.

    Raises ConfigError if the rig file cannot be used, or there is no such scene.
    """
    rig = config.load_rig(options.rig, options.overrides)
    scene, scene_overrides = options.scene or rig.scene, config.split_overrides(options.overrides)[1]
    wanted = scene_requirements(scene, scene_overrides)
    return ProcessConfig(
        name=name, rig=wanted.fitted(rig), scene_name=scene, scene_overrides=scene_overrides, log=log.set_up(name),
        requirements=wanted, prepare_only=options.prepare_only,
    )  # fmt: skip


def open_process(process_config: ProcessConfig, whole: Collection[str] = ()) -> Process:
    """Return the open process, with a socket for each topic that the table gives it and no other.

    For what nobody says, as its publisher has nothing to do in the scene, there is none.
    Of topics that are named in `whole` it gets every frame.

    The order is the point: scheduling first, then the ZeroMQ context, whose thread inherits it. From then until `ready`
    the process itself is an ordinary one, so that opening devices starves nobody.
    Raises UserError if an endpoint cannot be used.
    """
    name, rig, logger = process_config.name, process_config.rig, process_config.log
    settings = rig.process(name)
    facts, scheduling = realtime.set_up(
        settings.core, settings.priority, settings.nice, settings.share, rig.rungs, awake=not rig.spare_power
    )
    for fact in facts:
        _warn_of(fact, logger)
    requirements = process_config.requirements
    read, observed = (
        tuple(filter(requirements.is_published, read_by(name))),
        tuple(filter(requirements.is_published, observed_by(name))),
    )
    bus = ZmqBus(
        rig.transport,
        publishes=filter(requirements.is_read, published_by(name)),
        reads=[each for each in read if each not in whole],
        reads_every=[each for each in (*read, *observed) if each in whole],
        samples=[each for each in observed if each not in whole],
    )
    given = {each.name: getattr(process_config, each.name) for each in fields(process_config)}
    process = Process(**given, facts=facts, bus=bus, health=HealthReporter(name, bus), _scheduling=scheduling)
    process.health.realtime = facts
    if scheduling is not None:
        scheduling.relax()
    _stop_on_signals(process)
    process.health.change("starting", "building")
    return process


def _warn_of(fact: realtime.Fact, logger: logging.Logger) -> None:
    if not fact.ok:
        logger.warning("%s: asked for %s, had %s", fact.name, fact.asked, fact.had)


def listen_as(name: str, rig: Rig) -> ZmqBus:
    """Return a bus that hears what the table gives a process to read, and its health; it says nothing: a helper's.

    Processes that the rig does not run say nothing.
    """
    said = [each for each in read_by(name) if rig.process(topic(each).publisher).enabled]
    return ZmqBus(rig.transport, reads=(*said, f"{name}.health"))


def _stop_on_signals(process: Process) -> None:
    flag = process._stopping  # noqa: SLF001

    def stop(_signal: int, _frame: FrameType | None) -> None:
        flag[0] = True

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)


def main(
    name: str,
    run: Callable[..., None],
    arguments: Sequence[str] | None = None,
    *,
    prepare: Callable[[ProcessConfig], Any] | None = None,
    whole: Callable[[ProcessConfig], Collection[str]] | None = None,
) -> int:
    """Run a process from its command line; return the exit code. What a person can mend is one sentence.

    Args:
        name: Of the process.
        run: Called with the open process, and with what `prepare` returned where there is one.
        prepare: What takes long (bases, compiling kernels): done before the process is real-time, so that it starves
            nobody.
        whole: Returns the topics of which the process gets every frame, whatever the table says.
    """
    start_up.end()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until there is a loop to end in good order, just end
    try:
        options = parse(name, arguments)
        process_config = load_process_config(name, options)
        if name in process_config.requirements.idle:
            process_config.log.info("scene %s has nothing to do for it", process_config.scene_name)
            return 0
        prepared = () if prepare is None else (prepare(process_config),)
        if options.prepare_only:
            return 0
        process = open_process(process_config, whole(process_config) if whole else ())
        try:
            run(process, *prepared)
            process.health.change("stopping")
        finally:
            process.bus.close()
    except UserError as error:
        print(f"{name}: {error}", file=sys.stderr)  # noqa: T201
        return error.exit_code
    return 0
