"""A step that does not end soundly keeps the share of its motion that is sound, and the rest is counted."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.price import MARGIN
from trocar.services.mechanics.contact.working_set import tolerated_overlap_m
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation, step_solver
from trocar.services.mechanics.simulation.sound_start import begin_sound
from trocar.studies.judge.overlaps import OverlapJudge

ROUNDING_M = 1e-6
"""The judge and the price measure walls that are placed by different sums."""


def press(simulation, ticks, after=lambda tick: None):
    """Two forceps come down on the duct at 0.1 m/s, and go on into it."""
    tools = ToolInputs()
    for tick in range(ticks):
        tools.position_m[:] = (20e-3, 0.0, 21.5e-3 - 0.1e-3 * tick), (30e-3, 3e-3, 21.5e-3 - 0.1e-3 * tick)
        simulation.step(tools)
        after(tick)


def test_a_solve_without_rows_that_does_not_end_takes_nothing_deeper_than_is_sound(
    small_scene, small_duct, monkeypatch
):
    """Tools go on at 0.1 m/s, and no candidate ever gets a row: the motion is taken back, or nothing moves."""
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 5)
    judge, tolerance_m = OverlapJudge(simulation), tolerated_overlap_m(small_scene.duct.thickness_m)
    monkeypatch.setattr(simulation.search, "write_pairs", lambda state, pairs: None)
    monkeypatch.setattr(step_solver, "MOST_PRODUCTS", 1)
    worst_m = []
    press(simulation, 60, lambda _: worst_m.append(max(judge.look().values())))
    assert max(worst_m) < MARGIN * tolerance_m + ROUNDING_M
    assert max(worst_m) > tolerance_m, "nothing was pressed"
    assert simulation.withheld_s > 5e-3
    assert simulation.healed_states == 0


def test_a_share_of_a_motion_lies_between_its_ends_and_gives_out_no_energy(small_scene, small_duct):
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 40)
    share, duct, rod = simulation._motion_share, simulation.duct, simulation.catheter.state
    tools = ToolInputs()
    tools.position_m[:] = simulation.tools.hand[:, :3] + [0.0, 0.0, -0.3e-3]

    def state():
        return duct.state.q.copy(), duct.state.qdot.copy(), rod.position_m.copy(), rod.velocity_m_s.copy()

    def energy_j():
        return duct.kinetic_energy_j() + duct.strain_energy_j()

    begun, begun_j = state(), energy_j()
    simulation._start.save()
    assert simulation._move(tools, 1e-3)
    ended, ended_j = state(), energy_j()
    assert share.find(1.0, 1.0) == 1.0
    for part in (1.0, 0.25):
        share.take(part)
        for start, end, now in zip(begun, ended, state(), strict=True):
            assert now == pytest.approx(start + part * (end - start), rel=1e-12, abs=1e-15)
        assert energy_j() <= (1.0 - part) * begun_j + part * ended_j + 1e-15


def test_a_tick_without_work_left_withholds_all_of_its_time_and_moves_nothing(small_scene, small_duct, monkeypatch):
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 40)
    q, line_m = simulation.duct.state.q.copy(), simulation.catheter.state.position_m.copy()
    monkeypatch.setattr(step_solver, "MOST_PRODUCTS", 0)
    simulation.step(ToolInputs())
    assert simulation.withheld_s == pytest.approx(1e-3)
    assert np.array_equal(simulation.duct.state.q, q)
    assert np.array_equal(simulation.catheter.state.position_m, line_m)


def test_a_wall_whose_loads_press_it_through_the_catheter_begins_beside_it(small_scene, small_duct):
    """It began in equilibrium with the loads, beyond the catheter, and no step could bring it back."""
    simulation = Simulation(small_scene, small_duct)
    judge, duct = OverlapJudge(simulation), simulation.duct
    place_m = duct.reduced.mesh.vertices_m
    load_n = np.zeros_like(place_m)
    load_n[place_m[:, 2] > 0.0, 2] = -1.0
    duct.set_constant_load(load_n)
    lowest_m = simulation.catheter.state.position_m[:, 2].min()
    height_m = duct.surface_m()[place_m[:, 2] > 0.0, 2].min()
    assert height_m < lowest_m, "the load does not press the wall through the catheter"
    whole = duct.state.q.copy()
    begin_sound(simulation.world)
    assert 0.0 < np.linalg.norm(duct.state.q) < np.linalg.norm(whole)
    worst_m = [judge.look()["catheter"]]
    press(simulation, 30, lambda _: worst_m.append(judge.look()["catheter"]))
    assert max(worst_m) < 0.1e-3


def test_a_particle_has_one_film_of_mucus_however_many_facets_it_is_near(with_effects, small_duct):
    """Films were half of the rows where a table of 256 was full."""
    scene = with_effects(mucus_drag={})
    catheter = replace(
        scene.catheter, anchor="free", length_m=20e-3, n_segments=10, tip_position_m=(10e-3, 0.0, -2.35e-3)
    )
    simulation = Simulation(replace(scene, catheter=catheter), small_duct)
    simulation.step(ToolInputs(present=np.zeros(2, np.bool_)))
    rows = simulation.contacts
    films = np.flatnonzero(rows.law[: rows.n_contacts] == number_of("film"))
    assert sorted(rows.rod_node[films, 0]) == list(range(11))
    assert (rows.tool[films] == NO_TOOL).all()
