"""The physics process: tools and grasps in, one step per tick, one frame of state out."""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process
from trocar.protocol.topics import MOMENT_TICKS, TICK_HZ, TICK_S

# isort: split
import sys
import time
from functools import partial
from operator import add
from typing import TYPE_CHECKING

from trocar.protocol import Frame
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.simulation import STAGE_NAMES
from trocar.services.mechanics.snapshot import Snapshot
from trocar.services.physics.duct_alone_loop import STAGES as DUCT_STAGES
from trocar.services.physics.duct_alone_loop import run_duct_alone
from trocar.services.physics.inputs import ContactsReader
from trocar.services.physics.outputs import Outputs
from trocar.services.physics.warm_up import warm_up, warm_up_contact
from trocar.services.runtime.bus.journal import JournalWriter
from trocar.services.runtime.log import progress
from trocar.services.runtime.loop.loop import LoopMeter, TickClock, follow_topic
from trocar.services.runtime.loop.nan_guard import NanGuard
from trocar.services.runtime.process.process import Process, ProcessConfig, main
from trocar.services.scenes import load_duct, load_scene
from trocar.services.start import first_start
from trocar.services.start.start_progress import StartProgress

if TYPE_CHECKING:
    from trocar.services.physics.replaying import ReplayedPhysics

RATE_HZ = TICK_HZ
#: Ticks between polls for orders, which arrive ten times a second. A poll takes 7 us, an order 80 us, which dominated
#: the 99th percentile of a tick.
_ORDERS_EVERY = 16
STAGES = ("read", *STAGE_NAMES, "send")
#: Parts of a start, with their share of the time of a first one.
START = {"contact": 0.6, "duct": 0.1, "step": 0.3}


class Physics:
    """A simulation on the bus. A state with a NaN is written to a file and replaced by the scene at rest.

    `in_step` is whether the rig's time is simulated: then every frame is answered, as haptics waits for it.
    """

    def __init__(
        self, process: Process, meter: LoopMeter, scene: SceneModel, duct: ReducedDuct, *, in_step: bool = False
    ) -> None:
        self._in_step = in_step
        self._process = process
        self._meter = meter
        self._scene, self._duct = scene, duct
        self._begins: int | None = None
        self.follows_orders = True
        self._journal = JournalWriter("physics.journal", process.bus)
        self._begin()
        self.resets = self._looked = self._partial_ticks = 0
        meter.periods_allowed = scene.quality[0].ticks_per_step
        process.health.counts = self._counts

    def _begin(self) -> None:
        self.simulation = Simulation(self._scene, self._duct)
        self.simulation.inside_watch.tell = partial(self._process.log.warning, "%s")
        self._reader = ContactsReader(self.simulation)
        self._outputs = Outputs(self.simulation, self._duct.basis.content_hash)
        self._outputs.measure_inserted()  # finds by the whole wall where the catheter begins; a restart need not
        kept = (self._scene, self.simulation.scene, self._duct, self.simulation.duct.reduced)
        self._snapshot = Snapshot(self.simulation, kept)
        watched = {"q": self.simulation.duct.state.q, "catheter": self.simulation.catheter.state.position_m}
        self._guard = NanGuard("physics", watched, cache_directory() / "dumps")

    def advance(self, frame: Frame, ticks: int) -> None:
        """Advance by `ticks` with the tools of `frame` and publish the state, once the ticks complete a step.

        After a lost tick one may be left over, which waits for the next frame. As a step of its own it would change the
        step's length twice, and cached compliances are recomputed for each length: a single lost tick then delayed the
        steps after it as well. While the rig's time is stopped, the state is published again.
        """
        began_ns = time.monotonic_ns()
        self._meter.tick = frame.body.tick
        self._follow_begins(frame.body.begins)
        if ticks:
            self._journal.note(frame.body.tick, (ticks, self.simulation.quality_level, self.resets))
        self._partial_ticks += ticks
        length = self._meter.periods_allowed
        if self._partial_ticks < length and ticks:
            if self._in_step:
                self.republish(frame)
            return
        steps, self._partial_ticks = divmod(self._partial_ticks, length)
        if not self._reader.read_contacts(frame.body):
            self._process.health.gauges["refused_contacts"] = float(self._reader.refused)
            return
        read_ns = time.monotonic_ns() - began_ns
        costs_ns = [0] * len(STAGE_NAMES)
        healthy = all(self._step(costs_ns, length) for _ in range(steps))
        if not healthy:
            self._reset()
        stepped_ns = time.monotonic_ns()
        self._outputs.publish(self._process.bus, frame, valid=healthy)
        if self._in_step and ticks and frame.body.tick % MOMENT_TICKS == 0:
            self._outputs.publish_moment(self._process.bus, frame, valid=healthy)
        self._meter.stages_ns = (read_ns, *costs_ns, time.monotonic_ns() - stepped_ns)

    def _follow_begins(self, begins: int) -> None:
        """Restart the scene when the hands restart."""
        if self._begins is not None and begins > self._begins:
            level = self.simulation.quality_level
            self._snapshot.restore()
            if level:
                self.simulation.set_quality(level)
            self._partial_ticks = 0
            self._outputs.forget()
        self._begins = begins

    def _step(self, costs_ns: list[int], ticks: int) -> bool:
        """Take one step over `ticks`, adding the costs of its stages to `costs_ns`; return False if the new state has a
        NaN, which must not reach other kernels.
        """
        self.simulation.step(self._reader.tools, ticks * TICK_S)
        costs_ns[:] = map(add, costs_ns, self.simulation.cost_ns)
        return self._guard.watch()

    def _counts(self) -> dict[str, float]:
        dropped = self.simulation.dropped_contacts
        return {
            "dropped_pairs": float(dropped.pairs),
            "dropped_contacts": float(dropped.rows),
            "dropped_holds": float(dropped.holds),
            "refused_inputs": float(self.simulation.refused_inputs),
            "healed_states": float(self.simulation.healed_states),
            "withheld_s": self.simulation.withheld_s,
            "tools_inside": float(sum(self.simulation.inside_watch.inside)),
        }

    def _reset(self) -> None:
        self.resets += 1
        self._process.health.gauges["resets"] = float(self.resets)
        self._process.log.error("a state is not a number: wrote %s and began anew", self._guard.dumps[-1])
        level = self.simulation.quality_level
        self._begin()
        self.simulation.set_quality(level)

    @property
    def has_partial_step(self) -> bool:
        """Whether ticks wait for others to complete a step."""
        return self._partial_ticks > 0

    def begin_again(self) -> None:
        """Restart the scene."""
        self._begin()
        self._partial_ticks = 0

    def republish(self, frame: Frame) -> None:
        """Publish the state for a frame again, in case its receiver has missed it."""
        self._outputs.publish(self._process.bus, frame, valid=True)

    def do_side_work(self) -> None:
        """Run background work between two ticks."""
        if not (self._outputs.measure_inserted() or self._poll_quality_orders() or self._journal.send_if_due()):
            self._process.health.do_a_piece()

    def _poll_quality_orders(self) -> bool:
        """Poll for the quality level requested by the supervisor, if a poll is due; return whether it was."""
        self._looked += 1
        if self._looked % _ORDERS_EVERY:
            return False
        for state in self._process.bus.drain("supervisor.state"):
            if self.follows_orders:
                self.obey(state.body.quality_level)
        return True

    def obey(self, level: int) -> None:
        """Set a quality level requested by the supervisor, limited to the scene's ladder."""
        level = min(level, len(self._scene.quality) - 1)
        if level != self.simulation.quality_level:
            self.simulation.set_quality(level)
        self._meter.periods_allowed = self.simulation.rung.ticks_per_step
        self._process.health.quality_level = level


def prepare(process_config: ProcessConfig) -> tuple[SceneModel, ReducedDuct]:
    """Load the scene and its duct, and compile the kernels of a step."""
    start = StartProgress(START, progress)
    if misfit := first_start.notice_of_misfit():
        process_config.log.warning("%s", misfit)
    scene = load_scene(process_config.scene_name, process_config.scene_overrides)
    warm_up_contact(scene, start.part("contact"))
    duct = load_duct(scene, cache_directory(), start.part("duct"))
    warm_up(scene, duct, start.part("step"))
    if not scene.duct_alone:  # which leaves most kernels uncompiled
        first_start.leave_mark()
    start.finish("kernels are compiled")
    return scene, duct


def _log_residual_error(process: Process, duct: ReducedDuct) -> None:
    sentence = None if duct.residual_error is None else duct.residual_error.sentence()
    if sentence is not None:
        process.log.warning("%s", sentence)


def _replay(process: Process, physics: Physics) -> ReplayedPhysics | None:
    """Return a replay of a recording, if the rig replays one."""
    if process.rig.replay is None:
        return None
    from trocar.services.physics.replaying import (
        ReplayedPhysics,  # readers of recordings are not installed with every rig
    )
    from trocar.services.recordings.schedule import read_schedule

    return ReplayedPhysics(physics, read_schedule(process.rig.replay))


def run(process: Process, prepared: tuple[SceneModel, ReducedDuct]) -> None:
    """Step on each new tick of the rig's clock, or of the process' own clock if no tool provides one."""
    scene, duct = prepared
    if scene.duct_alone:
        _log_residual_error(process, duct)
        run_duct_alone(process, LoopMeter(RATE_HZ, DUCT_STAGES), scene, duct)
        return
    meter = LoopMeter(RATE_HZ, STAGES)
    physics = Physics(process, meter, scene, duct, in_step=process.rig.simulated_time)
    _log_residual_error(process, duct)
    clock = TickClock(meter)
    replay = _replay(process, physics)
    process.ready(meter)
    for frame in follow_topic(process.bus, "haptics.contacts", meter, process.stop, physics.do_side_work):
        if frame is not None:
            ticks = clock.steps(frame.body.tick)
            if not (replay and replay.replay_frame(frame)):
                physics.advance(frame, ticks)
            process.health.change("running")


if __name__ == "__main__":
    sys.exit(main("physics", run, prepare=prepare))
