"""Opening a process: options, configuration, real-time set-up, bus, signals; a failure is one clear sentence."""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, fields
from types import FrameType
from typing import Any

from trocar.protocol.topics import observed_by, published_by, read_by, topic
from trocar.services.runtime import log
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.config.scene_requirements import EVERYTHING, SceneRequirements, scene_requirements
from trocar.services.runtime.errors import BusError, UserError
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.measures.flight import SUFFIX, FlightRing, flight_directory
from trocar.services.runtime.process.health import HealthReporter
from trocar.services.runtime.realtime import realtime
from trocar.services.runtime.realtime.scheduling import Scheduling
from trocar.services.start import start_up


@dataclass(frozen=True, slots=True)
class Options:
    """Options of every process' command line."""

    rig: str
    scene: str | None
    overrides: tuple[str, ...]
    prepare_only: bool = False


@dataclass(slots=True, kw_only=True)
class ProcessConfig:
    """Configuration of a process."""

    name: str
    rig: Rig
    scene_name: str
    scene_overrides: tuple[str, ...]
    log: logging.Logger
    requirements: SceneRequirements = EVERYTHING
    prepare_only: bool = False


@dataclass(slots=True, kw_only=True)
class Process(ProcessConfig):
    """An open process. It ends through `stop`, never by an exit inside a loop."""

    facts: list[realtime.Fact]
    bus: ZmqBus
    health: HealthReporter
    _scheduling: Scheduling | None = None
    _stopping: list[bool] = field(default_factory=lambda: [False])

    def stop(self) -> bool:
        """Return whether the process was told to end."""
        return self._stopping[0]

    def ready(self, meter: LoopMeter | None = None, *, starts_others: bool = False) -> None:
        """Report that everything is built and compiled, and start real-time operation for the loop.

        With `starts_others`, child processes are not real-time, whatever this one is.
        """
        self.health.meter = meter
        if meter is not None:
            self._share(meter.flight)
        if self._scheduling is not None:
            self._scheduling.resume(alone=starts_others)
            had = realtime.scheduling_fact(self._scheduling)
            if had not in self.facts:
                _warn_of(had, self.log)
            self._tell(had)
        if not starts_others:
            self.facts.append(realtime.keep_pages())
        self.facts.extend((realtime.freeze_garbage_collector(), realtime.read_back()))
        self.health.realtime = self.facts
        self.health.change("ready")
        if not starts_others:  # a supervisor reports for them
            self.log.info("ready")

    def _tell(self, had: realtime.Fact) -> None:
        self.facts[:] = [had if fact.name == had.name else fact for fact in self.facts]

    def _share(self, ring: FlightRing) -> None:
        """Share the flight ring, which a rig can run without."""
        try:
            directory = flight_directory(endpoints.run_directory(self.rig.transport))
            ring.share(directory / f"{self.name}{SUFFIX}")
        except (BusError, OSError) as error:
            self.log.warning("the last ticks cannot be looked at: %s", error)


def parse(process: str, arguments: Sequence[str] | None) -> Options:
    """Return the options of a process' command line.

    ``TROCAR_RIG``, ``TROCAR_SCENE`` and ``TROCAR_SET`` (overrides, separated by spaces) are the defaults of options, so
    that one environment configures all containers of a rig. ``TROCAR_LOG_LEVEL`` is read as the log is set up.

    Raises ConfigError if there is no such level.
    """
    environment = os.environ
    parser = argparse.ArgumentParser(prog=f"python -m trocar.services.{process}")
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
    parser.add_argument("--log-level", metavar="LEVEL", help=f"{', '.join(log.LEVELS)}; or {log.LEVEL_VARIABLE}")
    parsed = parser.parse_args(arguments)
    if parsed.log_level is not None:
        log.level_of(parsed.log_level, "--log-level")
        environment[log.LEVEL_VARIABLE] = parsed.log_level  # for what it starts, too
    overrides = (*environment.get("TROCAR_SET", "").split(), *parsed.overrides)
    return Options(parsed.rig, parsed.scene, overrides, parsed.prepare_only)


def load_process_config(name: str, options: Options) -> ProcessConfig:
    """Return the configuration of a process, before it is real-time or on the bus.

    Raises ConfigError if the rig file is invalid, or there is no such scene.
    """
    rig = config.load_rig(options.rig, options.overrides)
    scene, scene_overrides = options.scene or rig.scene, config.split_overrides(options.overrides)[1]
    wanted = scene_requirements(scene, scene_overrides)
    return ProcessConfig(
        name=name, rig=wanted.fitted(rig).in_its_time(), scene_name=scene, scene_overrides=scene_overrides,
        log=log.set_up(name), requirements=wanted, prepare_only=options.prepare_only,
    )  # fmt: skip


def open_process(process_config: ProcessConfig, whole: Collection[str] = ()) -> Process:
    """Return the open process, with sockets for exactly the topics that the table assigns to it.

    Topics without a publisher in this scene are left out. Of topics named in `whole` it receives every frame.

    The order matters: scheduling first, then the ZeroMQ context, whose thread inherits it. From then until `ready` the
    process itself is an ordinary one, so that opening devices starves no other.
    Raises UserError if an endpoint is unavailable.
    """
    name, rig, logger = process_config.name, process_config.rig, process_config.log
    settings = rig.process(name)
    facts, scheduling = realtime.set_up(
        settings.core, settings.priority, settings.nice, settings.share, awake=not rig.spare_power
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


def observe(rig: Rig, topics: Iterable[str]) -> ZmqBus:
    """Return the bus of an observer of a rig, which reads the newest of each topic and publishes nothing.

    Topics of processes that the rig does not run are left out.
    """
    return ZmqBus(rig.transport, reads=[each for each in topics if rig.process(topic(each).publisher).enabled])


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
    """Run a process from its command line; return the exit code. User errors are printed as one sentence.

    Args:
        name: Name of the process.
        run: Called with the open process, and with the result of `prepare`, if any.
        prepare: Does slow work (bases, compiling kernels) before the process is real-time, so that it starves no other.
        whole: Returns the topics of which the process receives every frame, regardless of the table.
    """
    start_up.end()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until there is a loop to end in good order
    try:
        options = parse(name, arguments)
        process_config = load_process_config(name, options)
        if name in process_config.requirements.idle:
            process_config.log.info("scene %s has nothing to do for it", process_config.scene_name)
            return 0
        with nullcontext() if options.prepare_only else endpoints.claim(process_config.rig.transport, name):
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
