"""The physics process: tools and grasps in, one step per tick, one frame of state out."""

from __future__ import annotations

import sys
import time
from operator import add
from typing import TYPE_CHECKING

from protocol import Frame
from services.cache_directory import cache_directory
from services.mechanics.beginning import Beginning
from services.mechanics.reduction.reduced_duct import ReducedDuct
from services.mechanics.scene import SceneModel
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.simulation import STAGE_NAMES
from services.physics.duct_alone_loop import STAGES as DUCT_STAGES
from services.physics.duct_alone_loop import run_duct_alone
from services.physics.inputs import ContactsReader
from services.physics.outputs import Outputs
from services.physics.warm_up import warm_up, warm_up_contact
from services.runtime.journal import JournalWriter
from services.runtime.log import progress
from services.runtime.loop import LoopMeter, TickClock, follow
from services.runtime.nan_guard import NanGuard
from services.runtime.process import Process, ProcessConfig, main
from services.scenes import load_duct, load_scene

if TYPE_CHECKING:
    from services.physics.replaying import ReplayedPhysics

RATE_HZ = 1000.0
TICK_S = 1.0 / RATE_HZ
#: Orders are looked for after one tick of so many: they come ten times a second. To look takes 7 us, to find one 80:
#: within the tick that was its 99th percentile.
_ORDERS_EVERY = 16
STAGES = ("read", *STAGE_NAMES, "send")


class Physics:
    """A simulation on the bus. A state with a NaN is written to a file and replaced by the scene at rest."""

    def __init__(self, process: Process, meter: LoopMeter, scene: SceneModel, duct: ReducedDuct) -> None:
        self._process = process
        self._meter = meter
        self._scene, self._duct = scene, duct
        self._begins: int | None = None
        self.follows_orders = True
        self._journal = JournalWriter("physics.journal", process.bus)
        self._begin()
        self.resets = self._looked = self._owed = 0
        meter.periods_allowed = scene.quality[0].ticks_per_step
        process.health.counts = self._counts

    def _begin(self) -> None:
        self.simulation = Simulation(self._scene, self._duct)
        kept = (self._scene, self.simulation.scene, self._duct, self.simulation.duct.reduced)
        self._beginning = Beginning(self.simulation, kept)
        self._reader = ContactsReader(self.simulation)
        self._outputs = Outputs(self.simulation, self._duct.basis.content_hash)
        watched = {"q": self.simulation.duct_state.q, "catheter": self.simulation.catheter.state.position_m}
        self._guard = NanGuard("physics", watched, cache_directory() / "dumps")

    def advance(self, frame: Frame, ticks: int) -> None:
        """Go on by `ticks` with the tools of `frame` and publish where that leads, once they make up a whole step.

        Where a tick was lost, one may be left over: it waits for the next frame. To take it as a step of its own would
        change the step's length twice, and what is kept between contacts for one length is made anew for another: a
        single lost tick made the steps after it late as well. Where the rig's time stands, the state is told once more.
        """
        began_ns = time.monotonic_ns()
        self._meter.tick = frame.body.tick
        self._follow_begins(frame.body.begins)
        if ticks:
            self._journal.note(frame.body.tick, (ticks, self.simulation.quality_level, self.resets))
        self._owed += ticks
        length = self._meter.periods_allowed
        if self._owed < length and ticks:
            return
        steps, self._owed = divmod(self._owed, length)
        if not self._reader.take(frame.body):
            self._process.health.gauges["refused_contacts"] = float(self._reader.refused)
            return
        read_ns = time.monotonic_ns() - began_ns
        costs_ns = [0] * len(STAGE_NAMES)
        healthy = all(self._step(costs_ns, length) for _ in range(steps))
        if not healthy:
            self._reset()
        stepped_ns = time.monotonic_ns()
        self._outputs.publish(self._process.bus, frame, valid=healthy)
        self._meter.stages_ns = (read_ns, *costs_ns, time.monotonic_ns() - stepped_ns)

    def _follow_begins(self, begins: int) -> None:
        """Put everything back to the scene's start where the hands have begun again: the tools touch nothing yet."""
        if self._begins is not None and begins > self._begins:
            level = self.simulation.quality_level
            self._beginning.put_back()
            if level:
                self.simulation.set_quality(level)
            self._owed = 0
            self._outputs.forget()
        self._begins = begins

    def _step(self, costs_ns: list[int], ticks: int) -> bool:
        """Take one step over `ticks`, adding what its stages cost to `costs_ns`; False if it leads to what is not a
        number, which no kernel may ever see.
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
        }

    def _reset(self) -> None:
        self.resets += 1
        self._process.health.gauges["resets"] = float(self.resets)
        self._process.log.error("a state is not a number: wrote %s and began anew", self._guard.dumps[-1])
        level = self.simulation.quality_level
        self._begin()
        self.simulation.set_quality(level)

    @property
    def owes(self) -> bool:
        """Whether ticks wait for others to make up a whole step."""
        return self._owed > 0

    def begin_again(self) -> None:
        """Put everything back to where the scene begins."""
        self._begin()
        self._owed = 0

    def say_again(self, frame: Frame) -> None:
        """Publish the state that answers a frame once more: whoever waits for it may have missed it."""
        self._outputs.publish(self._process.bus, frame, valid=True)

    def settle(self) -> None:
        """Do what no tick waits for, between two."""
        if not (self._outputs.settle() or self._look_for_orders() or self._journal.send_if_due()):
            self._process.health.do_a_piece()

    def _look_for_orders(self) -> bool:
        """Take the quality level that the supervisor last asked for, if it is time to look; return whether it was."""
        self._looked += 1
        if self._looked % _ORDERS_EVERY:
            return False
        for state in self._process.bus.drain("supervisor.state"):
            if self.follows_orders:
                self.obey(state.body.quality_level)
        return True

    def obey(self, level: int) -> None:
        """Take the quality level that the supervisor asks for, as far as the scene's ladder goes."""
        level = min(level, len(self._scene.quality) - 1)
        if level != self.simulation.quality_level:
            self.simulation.set_quality(level)
        self._meter.periods_allowed = self.simulation.rung.ticks_per_step
        self._process.health.quality_level = level


def prepare(process_config: ProcessConfig) -> tuple[SceneModel, ReducedDuct]:
    """Load the scene and its duct, and compile what the steps call."""
    scene = load_scene(process_config.scene_name, process_config.scene_overrides)
    warm_up_contact(scene)
    duct = load_duct(scene, cache_directory(), progress)
    warm_up(scene, duct)
    return scene, duct


def _say_what_is_approximate(process: Process, duct: ReducedDuct) -> None:
    sentence = None if duct.residual_error is None else duct.residual_error.sentence()
    if sentence is not None:
        process.log.warning("%s", sentence)


def _replay(process: Process, physics: Physics) -> ReplayedPhysics | None:
    """Return what steps as recorded, where the rig replays a recording."""
    if process.rig.replay is None:
        return None
    from services.physics.replaying import ReplayedPhysics  # what reads recordings is not installed with every rig
    from services.recordings.schedule import read_schedule

    return ReplayedPhysics(physics, read_schedule(process.rig.replay))


def run(process: Process, prepared: tuple[SceneModel, ReducedDuct]) -> None:
    """Step on each new tick of the rig's clock, or of its own where no tool gives one."""
    scene, duct = prepared
    if scene.duct_alone:
        _say_what_is_approximate(process, duct)
        run_duct_alone(process, LoopMeter(RATE_HZ, DUCT_STAGES), scene, duct)
        return
    meter = LoopMeter(RATE_HZ, STAGES)
    physics = Physics(process, meter, scene, duct)
    _say_what_is_approximate(process, duct)
    clock = TickClock(meter)
    replay = _replay(process, physics)
    process.ready(meter)
    for frame in follow(process.bus, "haptics.contacts", meter, process.stop, physics.settle):
        if frame is not None:
            ticks = clock.steps(frame.body.tick)
            if not (replay and replay.take(frame)):
                physics.advance(frame, ticks)
            process.health.change("running")


if __name__ == "__main__":
    sys.exit(main("physics", run, prepare=prepare))
