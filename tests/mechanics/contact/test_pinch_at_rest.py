"""Jaws that hold a duct pinched come to rest on it, whatever the load, the roll and the speed at which they closed."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.scenes import load_scene
from trocar.services.scenes.hands import hands_of

CREEP_M_N = 5e-6  # the overlap at rest for each newton
REST_S, LATER_S = 1.2, 1.7


@pytest.fixture(scope="module")
def pinch(tmp_path_factory):
    scene = load_scene("pinch")
    duct = build_scene_duct(scene, tmp_path_factory.mktemp("basis"))
    return Simulation(scene, duct).scene, duct


def closing(scene, mesh, angle_rad, roll_rad, faster):
    """Return the hands of the pinch, that close to another angle, at another roll, so many times as fast."""
    played = hands_of(scene, mesh)
    jaws = played.motions[1]
    motion = replace(
        jaws,
        time_s=tuple(time / faster for time in jaws.time_s),
        jaw_angle_rad=(*jaws.jaw_angle_rad[:-1], angle_rad),
        roll_rad=tuple(roll + roll_rad for roll in jaws.roll_rad),
    )
    return replace(played, motions=(None, motion))


def depths_and_loads(simulation):
    """Return overlap and normal force of each pressed contact."""
    rows, k = simulation.contacts, simulation.contacts.n_contacts
    is_pressed = (rows.law[:k] == number_of("unilateral")) & (rows.force_n[:k, 0] > 0.0)
    return -(rows.gap_m + rows.rest_offset_m)[:k][is_pressed], rows.force_n[:k, 0][is_pressed]


@pytest.mark.parametrize(
    ("angle_rad", "roll_rad", "faster"),
    [(0.505, 0.0, 1.0), (0.505, 0.4, 4.0), (0.4, 0.0, 1.0), (0.4, 0.4, 4.0), (0.3, 0.0, 1.0), (0.3, 0.0, 4.0)],
)
def test_overlap_at_rest_is_that_of_the_load_and_none_creeps(pinch, angle_rad, roll_rad, faster):
    scene, duct = pinch
    simulation, tools = Simulation(scene, duct), ToolInputs()
    hands = closing(scene, duct.mesh, angle_rad, roll_rad, faster)
    for tick in range(round(1e3 * LATER_S)):
        hands.write_inputs(1e-3 * tick, tools)
        simulation.step(tools)
        if tick == round(1e3 * REST_S):
            before_m, before_n = depths_and_loads(simulation)
    depth_m, load_n = depths_and_loads(simulation)
    print(f"{load_n.sum():.3f} N, {1e6 * depth_m.max():.3f} um, {1e9 * (depth_m.max() - before_m.max()):.3f} nm deeper")
    assert load_n.sum() > 0.3
    assert (depth_m - CREEP_M_N * load_n).max() < 1e-6
    np.testing.assert_allclose(np.sort(depth_m), np.sort(before_m), atol=1e-9)
    np.testing.assert_allclose(np.sort(load_n), np.sort(before_n), atol=1e-5)
    assert simulation.system.sweeps <= 3
