"""A catheter that hangs still is not computed, and nobody can tell.

What it costs is counted in the interpreter's instructions and in calls of kernels: the same on every machine.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.instructions import instructions
from trocar.services.mechanics.bodies import catheter as catheter_body
from trocar.services.mechanics.rod.implicit import ImplicitIntegrator
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.duct_alone import DuctAlone


def test_sleeping_catheter_costs_its_motion_nothing_and_wakes_without_a_jump(with_effects, small_duct):
    """Hung until still, asleep for a while, then touched: the same course as one that never sleeps."""
    courses, aside = {}, {"tip_position_m": (60e-3, 40e-3, 0.0)}
    for sleeping in (True, False):
        scene = replace(with_effects(gravity={}), sleeping=sleeping)
        scene = replace(scene, catheter=replace(scene.catheter, anchor="clamped", viscous_drag_n_s_m2=0.2, **aside))
        simulation, tools, places = Simulation(scene, small_duct), ToolInputs(), []
        tools.present[:] = False
        for _ in range(1500):
            simulation.step(tools)
        assert simulation.catheter.is_asleep() == sleeping
        tools.present[0] = True
        tools.jaw_angle_rad[:] = 0.3
        for tick in range(300):
            tools.position_m[0] = 65e-3, 40e-3, 15e-3 - 6e-5 * tick
            simulation.step(tools)
            places.append(simulation.catheter.state.position_m.copy())
        courses[sleeping] = np.array(places)
    assert np.abs(courses[True] - courses[True][0]).max() > 1e-4
    assert np.abs(courses[True] - courses[False]).max() < 1e-6
    assert np.abs(np.diff(courses[True], axis=0)).max() < 1e-4


@pytest.fixture
def hanging(with_effects, small_duct):
    """A catheter beside the duct that may hang until it is still, tools gone; by its number of segments."""

    def hang(n_segments=30, *, sleeping=True):
        scene = replace(with_effects(gravity={}), sleeping=sleeping)
        catheter = replace(scene.catheter, n_segments=n_segments, anchor="clamped", tip_position_m=(60e-3, 40e-3, 0.0))
        simulation, tools = (
            Simulation(replace(scene, catheter=replace(catheter, viscous_drag_n_s_m2=0.2)), small_duct),
            ToolInputs(),
        )
        tools.present[:] = False
        for _ in range(1500):
            simulation.step(tools)
        assert simulation.catheter.is_asleep() == sleeping
        return simulation, tools

    return hang


def test_a_sleeping_catheter_is_one_question_a_tick(hanging, monkeypatch):
    """Its integrator is not called, nothing is factored, and it is asked once whether it sleeps on."""
    simulation, tools = hanging()
    asked = []

    def forbidden(*_):
        raise AssertionError("the integrator of a sleeping catheter was called")

    ask = catheter_body.continue_sleep
    monkeypatch.setattr(catheter_body, "continue_sleep", lambda *arguments: asked.append(1) or ask(*arguments))
    for name in ("predict", "step_freely", "correct", "compliance"):
        monkeypatch.setattr(ImplicitIntegrator, name, forbidden)
    for _ in range(10):
        simulation.step(tools)
    assert len(asked) == 10
    assert simulation.catheter.is_asleep()


def test_what_a_sleeping_catheter_takes_does_not_grow_with_it_and_is_half_of_what_one_awake_takes(hanging):
    asleep = [instructions(hanging(n)[0].catheter.predict, 1e-3) for n in (15, 30, 60)]
    awake = instructions(hanging(30, sleeping=False)[0].catheter.predict, 1e-3)
    assert asleep == [asleep[0]] * 3
    assert asleep[0] < 60
    assert 2 * asleep[0] < awake  # in the interpreter; one awake spends most in its kernel


def test_a_sleeping_duct_alone_is_one_question_whatever_its_modes(small_scene, small_duct):
    counts = {}
    for sleeping in (True, False):
        alone = DuctAlone(replace(small_scene, duct_alone=True, sleeping=sleeping), small_duct)
        for _ in range(3):  # what is not compiled yet is no part of a tick
            alone.step()
        assert alone.is_asleep() == sleeping
        counts[sleeping] = instructions(alone.step)
    assert counts[True] < 60
    assert 3 * counts[True] < counts[False]
