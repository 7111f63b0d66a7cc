"""The training process: follows the attempt, and reports it ten times a second and at changes."""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import sys
import time
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from trocar.protocol import Frame
from trocar.protocol.topics import HEALTH_S, PROCESSES, TICK_NS
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.loop.loop import LoopMeter, ticks
from trocar.services.runtime.loop.tick_grid import MOMENTS, Moments
from trocar.services.runtime.process.process import Process, ProcessConfig, main
from trocar.services.training.judge import Judge
from trocar.services.training.rig_observer import TOPICS
from trocar.services.training.scenario import Scenario, scenario_of
from trocar.services.training.score import load_rules
from trocar.services.training.site import Site, find_site
from trocar.services.training.trainer import Trainer

#: A fifth above the rate of `training.attempt`, so that a look is never late for a report.
RATE_HZ = 12.0
STAGES = ("orders", "look", "tell")
_PATIENCE_NS = 10 * TICK_NS  # ten periods of the sampled topics, so that a frame of each nearly always comes
_TELL_NS = round(1e9 * HEALTH_S)
_CONTINUED = "it goes on from a recording"


def prepare(config: ProcessConfig) -> tuple[Scenario | None, Site | None]:
    """Load the scenario of the rig or of its scene, and find the site of the mouth."""
    scenario = scenario_of(config.scene_name, config.rig.training.scenario)
    if scenario is None:
        return None, None
    site = find_site(config.scene_name, config.scene_overrides)
    site.check_branch(scenario.goal.branch)
    return scenario, site


def run(process: Process, prepared: tuple[Scenario | None, Site | None]) -> None:
    """Execute orders, follow the attempt, publish its state."""
    bus, rig = process.bus, process.rig
    scenario, site = prepared
    spared = [name for name in PROCESSES if not rig.process(name).critical]
    ways = TubePaths({name: np.array(way) for name, way in site.ways.items()}) if site is not None else None
    trainer = Trainer(
        scenario, rig.training.again_after_s, spared, lambda each: Judge(each, site), load_rules(), ways,
        simulated=rig.simulated_time, never_counts=_CONTINUED if _goes_on_by_hand(rig) else "",
    )  # fmt: skip
    look = _look_at_moments if rig.simulated_time else _look_at_newest
    moments = look(process)
    told, due_ns = None, 0
    meter = LoopMeter(RATE_HZ, STAGES)
    process.ready(meter)
    process.health.change("running")
    for tick in ticks(meter, process.stop):
        for frame in bus.drain("supervisor.state"):
            trainer.observer.take_rig(frame.body)
            trainer.obey(frame.body.orders)
        ordered_ns = time.monotonic_ns()
        if (hands := bus.latest("visualization.hands")) is not None:
            trainer.fitness.take_pictures(ordered_ns * 1e-9, hands.body.pictures_hz)
        for frames in moments():
            trainer.observer.take_frames(frames, ordered_ns)
            trainer.follow_attempt(ordered_ns * 1e-9)
        looked_ns = time.monotonic_ns()
        if looked_ns >= due_ns or trainer.gist() != told:
            told, due_ns = trainer.gist(), looked_ns + _TELL_NS
            bus.publish("training.attempt", trainer.tell())
        process.health.send_if_due()
        meter.stages_ns = (
            ordered_ns - tick.started_ns, looked_ns - ordered_ns, time.monotonic_ns() - looked_ns
        )  # fmt: skip


def _goes_on_by_hand(rig: Rig) -> bool:
    """Return whether hands take over where a recording ends."""
    return rig.replay is not None and rig.replay.take_over


def _look_at_newest(process: Process) -> Callable[[], Iterable[dict[str, Frame]]]:
    """Return what asks for the newest frame of each topic."""
    topics = tuple(filter(process.requirements.is_published, TOPICS))
    return lambda: [process.bus.sample(topics, time.monotonic_ns() + _PATIENCE_NS)]


def _look_at_moments(process: Process) -> Callable[[], Iterable[dict[str, Frame]]]:
    """Return what asks for all new moments, and last for none, as time may have passed."""
    moments = Moments()

    def look() -> Iterator[dict[str, Frame]]:
        yield from moments.take_frames(frame for name in MOMENTS for frame in process.bus.drain(name))
        yield {}

    return look


if __name__ == "__main__":
    sys.exit(main("training", run, prepare=prepare))
