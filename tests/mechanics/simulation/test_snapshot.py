"""A simulation restored from its snapshot is a new one, to the bit."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from tests.physics.conftest import SMALL
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.snapshot import Snapshot
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import hands_of

EVERY_EFFECT = (
    "effects={gravity: {}, friction: {}, grasp_slip: {}, twist: {}, viscoelasticity: {}, mucus_drag: {},"
    " self_contact: {}, gallstones: {position_m: [[26.0e-3, 0.0, -0.6e-3]], radius_m: [1.5e-3]}}"
)


def _states(simulation: Simulation, steps: int) -> bytes:
    """Let the scene's hands do so many steps, from the first; return all that came of it."""
    hands, inputs = hands_of(simulation.scene, simulation.duct.reduced.mesh), ToolInputs()
    said = []
    for k in range(steps):
        hands.write_inputs(k * 2e-3, inputs)
        simulation.step(inputs)
        rod, felt = simulation.catheter.state, simulation.tool_results
        said += [simulation.duct.state.q, rod.position_m, rod.velocity_m_s, felt.force_n, felt.stiffness_n_m]
        said = [b"".join(each if isinstance(each, bytes) else each.tobytes() for each in said)]
    return said[0]


@pytest.mark.parametrize("effects", [(), (EVERY_EFFECT,)], ids=["plain", "effects"])
def test_what_is_put_back_goes_on_as_a_new_one_does_to_the_bit(effects: tuple[str, ...]) -> None:
    scene = load_scene(SMALL, effects)
    duct = load_duct(scene, cache_directory(), lambda stage, fraction: None)
    simulation = Simulation(scene, duct)
    snapshot = Snapshot(simulation, (scene, simulation.scene, duct, simulation.duct.reduced))
    first = _states(simulation, 420)
    assert simulation.holds.active, "the hands hold nothing yet: little is there to be remembered"
    assert np.any(simulation.tool_results.force_n)
    snapshot.restore()
    assert _states(simulation, 420) == first
    assert _states(simulation, 420) != first, "what was remembered makes no difference: nothing is tested"
    assert sum(array.nbytes for array in snapshot._live) < 30e6


def test_lists_dictionaries_and_words_that_were_replaced_or_changed_come_back() -> None:
    class Part:
        __slots__ = ("kept", "number")

    Part.__module__ = "trocar.services.mechanics.part"
    part, array, constant = Part(), np.arange(3.0), np.zeros(2)
    part.kept, part.number = {"a": [1, array], "q": deque([1]), "c": constant}, 1
    snapshot = Snapshot(part, (constant,))
    array[:] = constant[:] = 9.0
    part.kept["a"].append(2)
    part.kept["q"].append(2)
    kept, part.kept, part.number = part.kept, {}, 2
    snapshot.restore()
    assert part.kept is kept
    assert part.number == 1
    assert kept["a"][0] == 1
    assert len(kept["a"]) == 2
    assert array.tolist() == [0.0, 1.0, 2.0]
    assert list(kept["q"]) == [1]
    assert constant.tolist() == [9.0, 9.0]
