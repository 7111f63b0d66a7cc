"""A scene that begins again with physics and haptics: with one tick, from the start, and with nothing of what was."""

from __future__ import annotations

import tracemalloc

import numpy as np

from tests.physics.conftest import Rig
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT
from trocar.services.mechanics.scene.tools import GraspHold

FAR = (0.02, -0.05, 0.08)


def _state(rig: Rig) -> bytes:
    simulation = rig.physics.simulation
    parts = simulation.duct.state.q, simulation.catheter.state.position_m, simulation.tool_results.force_n
    return b"".join(part.tobytes() for part in parts)


def _press(rig: Rig, ticks: int = 150) -> list[bytes]:
    """Lower the jaws of the first tool from above into the wall; return what came of each tick."""
    states = []
    for k in range(ticks):
        rig.turn((0.02, 0.0, 0.010 - 0.005 * min(1.0, 2.0 * k / ticks)), FAR)
        states.append(_state(rig))
    return states


def test_all_goes_on_from_the_start_to_the_bit_and_with_the_frame_that_says_so(rig: Rig) -> None:
    first = _press(rig)
    assert np.linalg.norm(rig.physics.simulation.tool_results.force_n[0]) > 0.01
    built = rig.physics.simulation
    rig.begins += 1
    assert _press(rig) == first
    assert rig.physics.simulation is built, "to build another one takes a second"
    assert rig.physics.resets == 0


def test_nothing_is_found_anew_from_the_whole_wall(rig: Rig) -> None:
    """It is kept from the start: between two ticks there is no time for it, and no memory."""
    _press(rig, 20)
    whole_wall = rig.physics.simulation.duct.reduced.basis.Phi.nbytes
    rig.begins += 1
    rig.turn(FAR, FAR)
    tracemalloc.start()
    try:
        rig.physics.do_side_work()
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < whole_wall / 4


def test_without_it_what_was_goes_on(rig: Rig) -> None:
    first = _press(rig)
    assert _press(rig) != first


def test_a_hand_that_is_in_the_wall_then_feels_nothing_until_it_has_left_it(rig: Rig) -> None:
    _press(rig)
    rig.begins += 1
    for _ in range(100):
        rig.turn((0.02, 0.0, 0.005), FAR)
        assert not rig.physics.simulation.tool_results.force_n.any()
        assert not rig.model().in_contact
    for height_m in np.linspace(0.005, 0.012, 50):
        rig.turn((0.02, 0.0, float(height_m)), FAR)
    _press(rig)
    assert rig.model().force_n[2] > 0.01


def test_haptics_holds_nothing_of_the_scene_that_was(rig: Rig) -> None:
    """Jaws that are still shut must not go on holding a catheter that is elsewhere now."""
    _press(rig, 20)
    held = GraspHold(1, 0, CATHETER_SEGMENT, 10, np.array([0.5, 0.5, 0.0]), 1.0, 0.1)
    rig.haptics.grasping.grasps[0].holds.append(held)
    rig.begins += 1
    rig.turn(FAR, FAR, handle_rad=0.0)
    assert not rig.haptics.grasping.scene.has_catheter, "what physics said of the scene before is not of this one"
    assert not any(grasp.holds for grasp in rig.haptics.grasping.grasps)
    assert not rig.physics.simulation.holds.active
    rig.turn(FAR, FAR, handle_rad=0.0)
    assert rig.haptics.grasping.scene.has_catheter


def test_a_gateway_that_starts_anew_begins_nothing(rig: Rig) -> None:
    rig.begins = 3
    _press(rig, 60)
    pressed = rig.physics.simulation.catheter.state.position_m.copy()
    rig.begins = rig.tick = 0
    rig.turn((0.02, 0.0, 0.005), FAR)
    assert np.abs(rig.physics.simulation.catheter.state.position_m - pressed).max() < 1e-4
    assert rig.haptics.grasping.scene.has_catheter


def test_where_time_stands_the_state_is_told_again_and_nothing_moves(rig: Rig) -> None:
    _press(rig, 100)
    before, tick = _state(rig), rig.tick - 1
    for k in range(20):
        rig.tick = tick
        rig.turn((0.02, 0.0, 0.005 + 1e-4 * k), FAR)
        assert _state(rig) == before
        told = rig.haptics_process.bus.latest("physics.state")
        assert told is not None, "silence would count as a hang"
        assert told.body.tick == tick
    assert rig.physics.resets == 0
    rig.turn((0.02, 0.0, 0.005), FAR)
    assert _state(rig) != before


def test_quality_stays_as_it_was(in_memory: type[Rig]) -> None:
    rig = in_memory("quality=[{name: full}, {name: two, ticks_per_step: 2}]")
    rig.physics.obey(1)
    for _ in range(40):
        rig.turn(FAR, FAR)
    rig.begins += 1
    for _ in range(10):
        rig.turn(FAR, FAR)
    assert rig.physics.simulation.quality_level == 1
    assert rig.physics.simulation.rung.ticks_per_step == 2
