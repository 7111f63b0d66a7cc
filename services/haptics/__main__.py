"""The haptics process: device frame in; contact model out to the servo, tools and contact pairs out to physics."""

from __future__ import annotations

import sys
import time

from protocol import Frame
from protocol.bodies import ContactModel, GatewayState
from services.cache_directory import cache_directory
from services.haptics.local_model import FREE, local_model
from services.haptics.outputs import tool_contacts
from services.haptics.tool_tracker import ToolTracker
from services.haptics.world import World
from services.mechanics.bodies.forceps.grasp import Grasp, deepest_touch
from services.mechanics.collision import CatheterContactDetector, ToolContactDetector
from services.mechanics.collision.pairs import DUCT_TRIANGLE, JAW_A, ContactPairs
from services.mechanics.reduction.duct import ReducedDuct
from services.mechanics.scene import SceneModel
from services.runtime.log import progress
from services.runtime.loop import LoopMeter, follow
from services.runtime.process import Process, ProcessConfig, main
from services.scenes import load_duct, load_scene

RATE_HZ = 1000.0


class Haptics:
    """Collision detection and haptic rendering of one scene."""

    def __init__(self, process: Process, scene: SceneModel, duct: ReducedDuct) -> None:
        self._bus, self._health = process.bus, process.health
        self._scene = scene
        self.world = World(scene, duct)
        self.tools = ToolTracker(scene)
        self._detector = make_detector(scene, self.world)
        catheter, contact = scene.catheter, scene.contact
        self._pairs = ContactPairs.allocate(contact.capacity)
        segment_m = catheter.length_m / catheter.n_segments
        self._grasps = [Grasp(i, each, duct.mesh, segment_m) for i, each in enumerate(self._scene.forceps)]
        self._ttl_s = 0.02

    def answer(self, frame: Frame) -> None:
        """Answer one device frame: the model first, since the hand waits for it; what it does not need comes after."""
        started = time.monotonic_ns()
        state: GatewayState = frame.body
        known = self._take_reactions()
        self._bus.publish("haptics.contact_model", self._model(state, known), origin_ns=frame.origin_ns, valid=known)
        modelled = time.monotonic_ns()
        self._take_shapes()
        hands = self.tools.take_hands(state)
        self._detect()
        detected = time.monotonic_ns()
        holds = [hold for i in range(len(hands)) for hold in self._grasps[i].update(self._pairs, self.tools.jaws(i))]
        body = tool_contacts(state.tick, hands, self._pairs, holds)
        self._bus.publish("haptics.contacts", body, origin_ns=frame.origin_ns, valid=frame.valid)
        self._count(started, modelled, detected)

    def _take_reactions(self) -> bool:
        """Take the newest solved forces; False if there are none fresh enough to act on."""
        contacts = self._bus.latest("physics.contacts")
        if contacts is not None:
            self.tools.take_reactions(contacts.body)
        known = self._bus.is_fresh("physics.contacts")
        if not known:
            self.tools.forget_reactions()
        return known

    def _take_shapes(self) -> None:
        duct, catheter = self._bus.latest("physics.duct"), self._bus.latest("physics.catheter")
        if duct is not None:
            self.world.take_duct(duct)
        if catheter is not None:
            self.world.take_catheter(catheter)

    def _model(self, state: GatewayState, known: bool) -> ContactModel:
        models = [
            local_model(self.tools.reactions[i], each, self._scene.forceps[i], touching=known)
            if i < len(self.tools.reactions)
            else FREE
            for i, each in enumerate(state.instruments)
        ]
        return ContactModel(tick=state.tick, ttl_s=self._ttl_s, instruments=tuple(models))

    def _detect(self) -> None:
        self._pairs.clear()
        if self.world.has_catheter:
            tools = self.tools
            self._detector.detect(tools.segments_m, tools.radius_m, self.world.particles_m, self._pairs, tools.present)

    def _count(self, started: int, modelled: int, detected: int) -> None:
        stages = self._health.stages
        stages.add("model", modelled - started)
        stages.add("detect", detected - modelled)
        stages.add("send", time.monotonic_ns() - detected)
        self._health.gauges.update({f"refused_{what}": float(n) for what, n in self.world.refused.items()})


def make_detector(scene: SceneModel, world: World) -> ToolContactDetector:
    """Return the collision detection of a scene's tools."""
    catheter = scene.catheter
    radius_m = 0.5 * catheter.outer_diameter_m
    return ToolContactDetector(world.surface, catheter.n_segments + 1, radius_m, scene.contact.margin_m)


def prepare(process_config: ProcessConfig) -> tuple[SceneModel, ReducedDuct]:
    """Load the scene and its duct, and compile every kernel on tools that lie across the duct at rest."""
    scene = load_scene(process_config.scene_name, process_config.scene_overrides)
    duct = load_duct(scene, cache_directory(), progress)
    world, tools = World(scene, duct), ToolTracker(scene)
    tools.present[:] = True
    tools.update_pose()
    tools.segments_m[:] = duct.mesh.vertices_m[0]
    tools.segments_m[:, :, 1] += 0.01
    world.warm_up()
    pairs = ContactPairs.allocate(scene.contact.capacity)
    progress("compiling collision detection", 0.0)
    make_detector(scene, world).detect(tools.segments_m, tools.radius_m, world.particles_m, pairs, tools.present)
    deepest_touch(pairs, 0, JAW_A, DUCT_TRIANGLE)
    # Not for haptics: physics compiles its dynamics meanwhile and finds this in the cache.
    catheter = scene.catheter
    CatheterContactDetector(world.surface, catheter.n_segments + 1, catheter.outer_diameter_m, 1e-3).detect(
        world.particles_m, pairs
    )
    progress("kernels are compiled", 1.0)
    return scene, duct


def run(process: Process, prepared: tuple[SceneModel, ReducedDuct]) -> None:
    """Answer each new device frame."""
    haptics = Haptics(process, *prepared)
    meter = LoopMeter(RATE_HZ)
    process.ready(meter)
    for frame in follow(process.bus, "gateway.state", meter, process.stop):
        if frame is not None:
            haptics.answer(frame)
            process.health.change("running")
        process.bus.drain("supervisor.state")
        process.health.send_if_due()


if __name__ == "__main__":
    sys.exit(main("haptics", run, prepare=prepare))
