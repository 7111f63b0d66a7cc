"""A catheter that hangs still is not computed, and nobody can tell."""

from dataclasses import replace

import numpy as np

from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation


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
