"""The haptics process: device frame in; contact model out to the servo, tools and grasps out to physics."""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process
from trocar.protocol.topics import MOMENT_TICKS, TICK_HZ

# isort: split
import sys
import time
from typing import TYPE_CHECKING

from trocar.protocol import Frame
from trocar.protocol.bodies import ContactModel, GatewayState, PhysicsState, ToolContacts
from trocar.protocol.bodies.haptics import tool_table
from trocar.services.files.cache_directory import cache_directory
from trocar.services.haptics.grasping import Grasping
from trocar.services.haptics.instruments import InstrumentTable
from trocar.services.haptics.local_model import LocalModels
from trocar.services.haptics.outputs import hold_body
from trocar.services.haptics.reactions import Reactions
from trocar.services.haptics.warm_up import warm_up
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.bus.journal import JournalWriter
from trocar.services.runtime.log import progress
from trocar.services.runtime.loop.loop import LoopMeter, follow_topic
from trocar.services.runtime.process.process import Process, ProcessConfig, main
from trocar.services.scenes import load_duct, load_scene
from trocar.services.start.start_progress import StartProgress

if TYPE_CHECKING:
    from trocar.services.haptics.replaying import ReplayedHaptics

RATE_HZ = TICK_HZ
STAGES = ("model", "detect", "send")
#: Parts of a start, with their share of the time of a first one.
START = {"duct": 0.2, "kernels": 0.8}
#: Longest wait for physics within a tick of simulated time; the gateway repeats the tick later.
_IN_STEP_NS = 5_000_000
_NO_CONTACTS = ToolContacts(tick=-1, tools=tool_table(()))


class Haptics:
    """Grasps and haptic rendering of one scene; `in_step` is whether the rig's time is simulated.

    Attributes:
        ticks_per_step: int. Ticks per step of physics now; tools and grasps are sent to it no more often.
    """

    def __init__(
        self, process: Process, meter: LoopMeter, scene: SceneModel, duct: ReducedDuct, *, in_step: bool = False
    ) -> None:
        self._in_step, self._is_solved = in_step, False
        self._arrived: Frame | None = None
        self._answered_tick = -1
        self._model: tuple[ContactModel, int, bool] | None = None
        self._bus, self._meter, self._health = process.bus, meter, process.health
        self._journal = JournalWriter("haptics.journal", process.bus)
        self._seen_tick = -1
        self._reactions, self._instruments = Reactions(), InstrumentTable(len(scene.forceps))
        tables = self._reactions.rows, self._instruments.rows
        self._models = LocalModels(scene.forceps, *tables)
        self.grasping = Grasping(scene, duct, *tables)
        self._ttl_s = 0.02
        self._solved: PhysicsState | None = None
        self._contacts, self.ticks_per_step = _NO_CONTACTS, 1
        self._begins: int | None = None
        self._began_tick = 0
        process.health.counts = self._counts

    def answer(self, frame: Frame) -> None:
        """Answer one device frame: first the model, for which the hand waits, then tools and grasps for physics."""
        started = time.monotonic_ns()
        state: GatewayState = frame.body
        self._follow_begins(state)
        if self._in_step and (state.tick == self._answered_tick or not self._wait_for_physics()):
            self._repeat(frame)
            return
        solved, self._arrived = (self._arrived, None) if self._in_step else (self._bus.latest("physics.state"), None)
        self._instruments.take_states(state.instruments)
        known = self._take_reactions(solved)
        models = self._models.table(len(state.instruments), touching=known)
        model = ContactModel(tick=state.tick, ttl_s=self._ttl_s, models=models)
        self._bus.publish("haptics.contact_model", model, origin_ns=frame.origin_ns, valid=known, at_once=True)
        self._answered_tick, self._model = state.tick, (model, frame.origin_ns, known)
        modelled = time.monotonic_ns()
        age = state.tick - self._seen_tick if self._seen_tick >= 0 else -1
        self._journal.note(state.tick, (age, int(known), frame.sequence - state.tick))
        self._meter.tick = state.tick
        is_published = 0 < state.tick - self._contacts.tick < self.ticks_per_step
        # The hand has its model. Tools and grasps for physics are due once a step, with its last tick.
        self._meter.periods_allowed = 1 if is_published else self.ticks_per_step
        publish_ns = (0, 0) if is_published else self._publish_contacts(frame, modelled)
        self._meter.stages_ns = (modelled - started, *publish_ns)

    def _follow_begins(self, state: GatewayState) -> None:
        """Restart when the scene does; states of physics from earlier ticks are then ignored."""
        if self._begins is not None and state.begins > self._begins:
            self.grasping.begin_again()
            self._solved = None
            self._began_tick, self._contacts = state.tick, _NO_CONTACTS
        elif state.tick < self._began_tick:  # the gateway has restarted
            self._began_tick = 0
        if self._in_step and state.tick < self._contacts.tick:
            self._contacts, self._seen_tick, self._arrived = _NO_CONTACTS, -1, None
        self._begins = state.begins

    def _repeat(self, frame: Frame) -> None:
        """Send again what answers the last tick, in case it was lost."""
        if self._model is not None:
            model, origin_ns, known = self._model
            self._bus.publish("haptics.contact_model", model, origin_ns=origin_ns, valid=known, at_once=True)
        self._bus.publish("haptics.contacts", self._contacts, origin_ns=frame.origin_ns, valid=frame.valid)

    def _wait_for_physics(self) -> bool:
        """Wait a little until physics has answered the last tools and grasps; return whether it has.

        In simulated time a tick is answered only then, so that its answer depends on nothing but the tick. The gateway
        repeats a tick that is not answered.
        """
        until_ns = time.monotonic_ns() + _IN_STEP_NS
        while self._seen_tick < self._contacts.tick:
            if self._arrived is not None and self._arrived.body.tick >= self._contacts.tick:
                break
            if not self._bus.wait("physics.state", until_ns):
                return False
            self._arrived = self._bus.latest("physics.state") or self._arrived
        return True

    def _publish_contacts(self, frame: Frame, began_ns: int) -> tuple[int, int]:
        """Detect the contacts of closing jaws and send tools and grasps to physics; return both durations, in ns.

        While the rig's time stands, those of its tick are sent again: physics steps once, with any of them.
        """
        state: GatewayState = frame.body
        if state.tick != self._contacts.tick:
            if self._solved is not None:
                self.grasping.update_shapes(self._solved)
                self._solved = None
            hands = self.grasping.follow_hands(self._instruments.count, state.withdrawn)
            held = tuple(map(hold_body, self.grasping.update()))
            self._contacts = ToolContacts(
                tick=state.tick, tools=hands, holds=held, begins=state.begins, withdrawn=state.withdrawn
            )
            if self._in_step and state.tick % MOMENT_TICKS == 0:
                self._bus.publish("haptics.moment", self._contacts, origin_ns=frame.origin_ns, valid=frame.valid)
        detected = time.monotonic_ns()
        self._bus.publish("haptics.contacts", self._contacts, origin_ns=frame.origin_ns, valid=frame.valid)
        return detected - began_ns, time.monotonic_ns() - detected

    def _take_reactions(self, solved: Frame | None) -> bool:
        """Store new solved forces; return False if there are none fresh enough to act on."""
        if solved is not None and solved.body.tick < self._began_tick:
            solved = None
            self._reactions.forget()
        if solved is not None:
            self._solved = solved.body
            self._seen_tick = solved.body.tick
            self._reactions.take_table(self._solved.tools)
            self.ticks_per_step = self._solved.ticks_per_step
        if self._in_step:
            is_known = self._is_solved and self._seen_tick >= self._began_tick
            self._is_solved = is_known if solved is None else solved.valid
        known = self._is_solved if self._in_step else self._bus.is_fresh("physics.state")
        if not known:
            self._reactions.forget()
            self.ticks_per_step = 1
        return known

    def do_side_work(self) -> None:
        """Run background work between two ticks."""
        if not self._journal.send_if_due():
            self._health.do_a_piece()

    def _counts(self) -> dict[str, float]:
        refused = {f"refused_{what}": float(n) for what, n in self.grasping.scene.refused.items()}
        return {"dropped_pairs": float(self.grasping.touches.dropped), **refused}


def prepare(process_config: ProcessConfig) -> tuple[SceneModel, ReducedDuct]:
    """Load the scene and its duct, and compile every kernel."""
    start = StartProgress(START, progress)
    scene = load_scene(process_config.scene_name, process_config.scene_overrides)
    duct = load_duct(scene, cache_directory(), start.part("duct"))
    warm_up(scene, duct, start.part("kernels"))
    start.finish("kernels are compiled")
    return scene, duct


def _replay(
    process: Process, meter: LoopMeter, prepared: tuple[SceneModel, ReducedDuct]
) -> ReplayedHaptics[Haptics] | None:
    """Return a replay of a recording, if the rig replays one."""
    if process.rig.replay is None:
        return None
    from trocar.services.haptics.replaying import (
        ReplayedHaptics,  # readers of recordings are not installed with every rig
    )
    from trocar.services.recordings.schedule import read_schedule

    schedule = read_schedule(process.rig.replay)
    return ReplayedHaptics(process, lambda inside: Haptics(inside, meter, *prepared), schedule)


def run(process: Process, prepared: tuple[SceneModel, ReducedDuct]) -> None:
    """Answer each new device frame."""
    meter = LoopMeter(RATE_HZ, STAGES)
    haptics = _replay(process, meter, prepared) or Haptics(
        process, meter, *prepared, in_step=process.rig.simulated_time
    )
    process.ready(meter)
    for frame in follow_topic(process.bus, "gateway.state", meter, process.stop, haptics.do_side_work):
        if frame is not None:
            haptics.answer(frame)
            process.health.change("running")


if __name__ == "__main__":
    sys.exit(main("haptics", run, prepare=prepare))
