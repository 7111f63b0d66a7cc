"""A scene that names but a duct: the same wall as in a whole simulation, of which nothing else is built."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.duct_alone import DuctAlone
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct

OF_WALL = [name for name, entry in EFFECTS.items() if entry.kind.of_wall]
SETTINGS = {"gravity": {"on_duct": True}}


def kicked(state):
    """Set the modes in motion, at less than what a whole simulation takes a tick in parts for."""
    state.qdot[:] = 0.001 * 0.7 ** np.arange(state.qdot.size)


@pytest.mark.parametrize("name", ["nothing", *OF_WALL])
def test_moves_to_the_last_bit_as_a_duct_that_nobody_touches(name, with_effects, cache_dir):
    scene = with_effects(**({} if name == "nothing" else {name: SETTINGS.get(name, {})}))
    scene = replace(scene, catheter=replace(scene.catheter, tip_position_m=(0.2, 0.0, 0.0)))
    duct = build_scene_duct(scene, cache_dir)
    whole, alone = Simulation(scene, duct), DuctAlone(replace(scene, duct_alone=True), duct)
    nobody = ToolInputs(present=np.zeros(2, np.bool_))
    kicked(whole.duct.state)
    kicked(alone.state)
    began = alone.state.q.copy()
    for _ in range(100):
        whole.step(nobody)
        alone.step()
    assert np.abs(alone.state.q - began).max() > 1e-7
    assert (alone.state.q == whole.duct.state.q).all()
    assert (alone.state.qdot == whole.duct.state.qdot).all()


@pytest.mark.parametrize("integrator", ["newmark", "exact"])
def test_at_rest_it_sleeps_and_wakes_without_a_jump(integrator, small_scene, small_duct):
    scene = replace(small_scene, duct_alone=True, duct=replace(small_scene.duct, integrator=integrator))
    courses = {}
    for sleeping in (True, False):
        alone = DuctAlone(replace(scene, sleeping=sleeping), small_duct)
        kicked(alone.state)
        assert not alone.is_asleep()
        for _ in range(3000):
            alone.step()
        assert alone.is_asleep() == sleeping
        slept = alone.state.q.copy()
        for _ in range(100):
            alone.step()
        assert (alone.state.q == slept).all() or not sleeping
        kicked(alone.state)
        courses[sleeping] = np.array([(alone.step(), alone.state.q.copy())[1] for _ in range(50)])
    assert np.abs(courses[True]).max() > 1e-7
    assert np.abs(courses[True] - courses[False]).max() < 1e-9 * np.abs(courses[True]).max()


def test_a_number_that_is_none_never_sleeps(small_scene, small_duct):
    alone = DuctAlone(replace(small_scene, duct_alone=True), small_duct)
    assert alone.is_asleep()
    alone.state.qdot[0] = np.nan
    assert not alone.is_asleep()


def test_what_a_whole_scene_names_is_no_duct_alone(small_scene, small_duct):
    with pytest.raises(ValueError, match="names more than a duct"):
        DuctAlone(small_scene, small_duct)


def test_one_tool_is_a_scene_whose_second_tool_is_absent(small_scene, small_duct):
    """To the last bit, whatever an input says of the tool that is not named; and it has no grasp."""
    states = []
    for forceps in (small_scene.forceps, small_scene.forceps[:1]):
        simulation, tools = Simulation(replace(small_scene, forceps=forceps), small_duct), ToolInputs()
        tools.present[1] = len(forceps) == 1  # claimed, but there is none
        tools.jaw_angle_rad[:] = 0.3
        tools.position_m[1] = 20e-3, 0.0, 2e-3
        touched = 0
        for tick in range(150):
            tools.position_m[0] = 20e-3, 0.0, 23e-3 - 1e-4 * tick
            simulation.step(tools)
            touched = max(touched, simulation.contacts.n_contacts)
        assert touched > 0
        assert len(simulation.grasps) == len(forceps)
        states.append((simulation.duct.state.q.copy(), simulation.catheter.state.position_m.copy()))
    assert all((one == other).all() for one, other in zip(*states, strict=True))
