"""An attempt at a scenario that the hands of its scene make, through haptics and physics, judged as a recording is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from tests.training.simulated import SimulatedRig
from tests.training.simulated import attempt as word
from trocar.protocol import Frame
from trocar.protocol.bodies import GatewayState
from trocar.review.attempts.assess import Message, Terms, assess
from trocar.review.attempts.assessment import Assessment
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.simulation import Simulation
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import hands_of
from trocar.services.training.attempt import FollowedAttempt
from trocar.services.training.rig_observer import RigObserver
from trocar.services.training.scenario import Scenario
from trocar.services.training.score import load_rules

#: Of the hands' script in the stub rig.
PACE = 0.2
#: Ticks between frames that the recorder keeps.
KEPT_EVERY = 20
COARSE = ("duct.n_around=20", "duct.n_along=26", "duct.n_modes=40")


def attempt_of_hands(scenario: Scenario, overrides: Sequence[str] = (), pace: float = PACE) -> Assessment:
    """Return the attempt that the scene's hands make, ended where the goal is reached and held."""
    scene = load_scene(scenario.scene, (*scenario.set, *COARSE, *overrides))
    duct = load_duct(scene, cache_directory(), lambda stage, fraction: None)
    hands = hands_of(Simulation(scene, duct).scene, duct.mesh)
    rig, attempt = SimulatedRig(hands, pace), FollowedAttempt(scenario.goal)
    terms = Terms(scenario_of=lambda _: scenario, rules=load_rules(), site=rig.site)
    ways = TubePaths({name: np.array(way) for name, way in rig.site.ways.items()})
    observer = RigObserver((), ways, scenario.goal.branch)
    (found,) = assess(_told(rig.messages(hands.duration_s / pace), attempt, observer, scenario.name), terms)
    return found


def _told(messages: Iterator[Message], attempt: FollowedAttempt, observer: RigObserver, name: str) -> Iterator[Message]:
    """Yield what the recorder keeps of a stream, and the attempt as the training process tells of it, up to its end."""
    yield "training.attempt", 0, word("armed", scenario=name)
    for topic, time_ns, body in messages:
        observer.take_frames({topic: Frame(1, topic, 1, 1, 0, 0, 0, True, body)}, time_ns)
        if body.tick % KEPT_EVERY == 0:
            yield topic, time_ns, body
        if isinstance(body, GatewayState) and body.tick % KEPT_EVERY == 0:
            before = attempt.state
            if (look := observer.observe()) is not None:
                attempt.observe(look)
            if attempt.state is not before:
                said = {"outcome": attempt.outcome, "time_s": attempt.time_s, "scenario": name}
                yield "training.attempt", time_ns, word(attempt.state.value, **said)
            if attempt.ended:
                return
