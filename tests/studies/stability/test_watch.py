"""Every criterion sees what it is for: a state is spoilt on purpose, and the figure of that fault fails."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from trocar.services.mechanics.bodies.catheter import initial_state, rod_properties
from trocar.services.mechanics.contact.laws import HAS_GAP
from trocar.services.mechanics.reduction import ModalState, Newmark
from trocar.services.mechanics.reduction.viscoelastic import PronySeries
from trocar.services.mechanics.rod import Supports, build_integrator
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.energy_book import EnergyBook
from trocar.studies.stability import finely
from trocar.studies.stability.criteria import CRITERIA, REST_S, failures
from trocar.studies.stability.drive import (
    Play,
    catheter_settling_s,
    creep_settling_s,
    drive,
    reduced_duct,
    wall_settling_s,
)
from trocar.studies.stability.hands import least_jerk
from trocar.studies.stability.situations import LEAD_STEPS, beside, threaded
from trocar.studies.stability.watch import Watch


def run(before_step):
    start = beside()
    return drive(Play(scene=start.scene, hands=start.hands.sampled(np.arange(100)), before_step=before_step)).figures


def test_nothing_is_wrong_where_nothing_was_spoilt():
    figures = run(None)
    assert failures(figures) == []
    assert {"gain", "imbalance", "speed", "penetration_any", "crossings", "force_step", "rest"} <= figures.keys()


def test_energy_that_nobody_put_in_is_a_gain():
    def kick(simulation, step):
        if step == 60:
            simulation.catheter.state.velocity_m_s[:, 2] += 0.3

    assert "gain" in failures(run(kick))


def shoot(simulation):
    simulation.catheter.state.velocity_m_s[:, 2] += 60.0


def draw_out(simulation):
    simulation.catheter.state.position_m[:] *= 1.2


def put_through_the_wall(simulation):
    simulation.catheter.state.position_m[-6:, 1] += 8e-3


def press(simulation):
    simulation.tool_results.force_n[0, 0] += 0.4


def push_a_contact(simulation):
    rows = simulation.contacts
    rows.n_contacts = 1
    rows.tool[0] = 0
    rows.lever[0] = np.eye(3, 4)
    simulation.contact_force_n[0] = 0.4, 0.0, 0.0


def lose(simulation):
    simulation.catheter.state.velocity_m_s[-1, 0] = np.nan


@pytest.mark.parametrize(
    ("spoil", "criterion"),
    [
        (shoot, "speed"),
        (draw_out, "stretch"),
        (put_through_the_wall, "crossings"),
        (press, "felt_error"),
        (push_a_contact, "force_step"),
        (lose, "not_finite"),
    ],
)
def test_the_figure_of_a_fault_fails_and_that_of_a_sound_state_does_not(spoil, criterion):
    start, tools = beside(), ToolInputs()
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    start.hands.write(0, tools)
    simulation.step(tools)
    watch = Watch(simulation, 0.1)
    assert watch.look(1e-3, None)
    watch.count_crossings()
    assert watch.worst[criterion] <= CRITERIA[criterion].limit
    spoil(simulation)
    if watch.look(1e-3, None):
        watch.count_crossings()
    assert watch.worst[criterion] > CRITERIA[criterion].limit


def test_a_force_that_springs_away_is_a_fall_and_its_reversal_a_step():
    start, tools = beside(), ToolInputs()
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    start.hands.write(0, tools)
    simulation.step(tools)
    watch = Watch(simulation, 0.1)
    push_a_contact(simulation)
    assert watch.look(1e-3, None)
    assert watch.worst["force_fall"] == 0.0
    watch.worst["force_step"] = 0.0
    simulation.contact_force_n[0] = 0.1, 0.0, 0.0
    watch.look(1e-3, None)
    assert watch.worst["force_fall"] == pytest.approx(0.3)
    assert watch.worst["force_step"] < 1e-12
    simulation.contact_force_n[0] = -0.2, 0.0, 0.0
    watch.look(1e-3, None)
    assert watch.worst["force_step"] == pytest.approx(0.2)


def squeezing():
    """Jaws that have closed on wall and catheter."""
    start, tools = threaded(), ToolInputs()
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    hands = start.hands.with_jaws(1, np.linspace(1.15, 0.25, 150), 20)
    for step in range(170):
        hands.write(step, tools)
        simulation.step(tools)
    return simulation, tools


def test_what_jaws_have_squeezed_away_is_no_overlap():
    simulation, _ = squeezing()
    rows = simulation.contacts
    n = rows.n_contacts
    in_jaws = (rows.tool[:n] == 1) & np.array(HAS_GAP)[rows.law[:n]]
    assert (rows.rest_offset_m[:n] * in_jaws).max() > 0.1e-3
    found = Watch(simulation, 0.1)
    for _ in range(10):
        found.look(1e-3, None)
    assert found.worst["tool_penetration"] < 0.05e-3 < (-rows.gap_m[:n] * in_jaws).max()


def test_depth_is_seen_where_rows_say_nothing():
    """The catheter's middle bent into the wall, between ticks: by brute force, within the time between two looks."""
    simulation, _ = squeezing()
    watch = Watch(simulation, 0.1)
    simulation.catheter.state.position_m[-4:, 2] -= 3e-3
    simulation.contacts.n_contacts = 0
    for _ in range(5):
        watch.look(1e-3, None)
    assert watch.worst["penetration"] > CRITERIA["penetration_hand"].limit


def test_the_tick_in_which_a_heal_comes_counts():
    """Nothing acts on a tool all at once: that is a step of its force, and no fall."""
    simulation, tools = squeezing()
    watch, book = Watch(simulation, 0.1), EnergyBook(simulation)
    book.step(tools)
    watch.look(1e-3, book.flow)
    watch.worst["force_step"] = 0.0
    simulation.catheter.state.velocity_m_s[-1] = 100.0
    book.step(tools)
    assert simulation.healed_states == 1
    watch.look(1e-3, book.flow)
    assert watch.worst["force_step"] > 0.01


@pytest.mark.parametrize("heavier", [1.0, 100.0])
def test_a_wall_settles_by_its_own_damping_in_the_time_that_it_is_given(heavier):
    scene = beside().scene
    duct = replace(scene.duct, density_kg_m3=heavier * scene.duct.density_kg_m3)
    reduced = reduced_duct(replace(scene, duct=duct))
    state, none = ModalState.at_rest(reduced.basis.n_modes), np.zeros(reduced.basis.n_modes)
    modes, rates = Newmark(reduced.basis.omega_rad_s, reduced.damping_ratio), []
    state.qdot[:] = 1.0
    steps = round(wall_settling_s(reduced) / 1e-3)
    for _ in range(steps):
        modes.predict(state, none, 1e-3)
        rates.append(np.abs(state.qdot[:2]).max())
    swing = round(2.0 * np.pi / reduced.basis.omega_rad_s[0] / 1e-3)
    assert max(rates[-swing:]) < 2.5e-3
    assert max(rates[: steps // 2][-swing:]) > 20e-3


@pytest.mark.parametrize("heavier", [1.0, 10.0])
def test_a_catheter_settles_by_its_drag_in_the_time_that_it_is_given(heavier):
    scene = beside().scene.catheter
    scene = replace(scene, density_kg_m3=heavier * scene.density_kg_m3, internal_damping_s=0.0)
    rod = rod_properties(scene)
    settling_s = catheter_settling_s(rod, rod.length_m)
    assert (settling_s > REST_S) == (heavier > 1.0)
    integrator = build_integrator("implicit", rod, Supports(held=(0,), start_direction=scene.direction), 1.0)
    state, speeds = initial_state(scene, rod), []
    along = np.linspace(0.0, 1.0, len(state.position_m))
    state.velocity_m_s[:, 2] = along**2
    for _ in range(round(settling_s / 1e-3)):
        integrator.predict(state, np.zeros_like(state.position_m), 1e-3)
        speeds.append(np.abs(state.velocity_m_s).max())
    half, swing = len(speeds) // 2, len(speeds) // 8
    assert max(speeds[-swing:]) < 3e-3
    assert max(speeds[half - swing : half]) > 10e-3


@pytest.mark.parametrize("series", [PronySeries((0.3,), (0.5,)), PronySeries((0.2, 0.15, 0.1), (0.1, 1.0, 10.0))])
def test_a_wall_that_relaxes_creeps_back_in_the_time_that_it_is_given(series):
    """Its balance q = sum g d, and each d following q, integrated by SciPy: held by 40 mm for long, and let go."""
    g, tau_s, held_m = np.array(series.g), np.array(series.tau_s), 40e-3
    given_s = creep_settling_s(series, held_m)

    def lag(_, d):
        return (g @ d - d) / tau_s

    times_s = np.linspace(0.0, given_s, 2000)
    d = solve_ivp(lag, (0.0, given_s), np.full(len(g), held_m), t_eval=times_s, rtol=1e-9, atol=1e-12).y
    speed_m_s = np.abs(g @ ((g @ d - d) / tau_s[:, None]))
    assert speed_m_s[-1] < 1.2e-3
    assert speed_m_s[len(times_s) // 4] > 1.2e-3


def test_a_supple_catheter_creeps_back_in_the_time_that_it_is_given():
    scene = beside().scene.catheter
    scene = replace(scene, youngs_modulus_pa=0.02 * scene.youngs_modulus_pa, internal_damping_s=0.0)
    rod = rod_properties(scene)
    integrator = build_integrator("implicit", rod, Supports(held=(0,), start_direction=scene.direction), 1.0)
    state, speeds = initial_state(scene, rod), []
    along = np.linspace(0.0, 1.0, len(state.position_m))
    state.position_m[:, 2] += 2e-3 * along**2 * (6.0 - 4.0 * along + along**2) / 3.0  # an even load's, near the mode's
    for _ in range(2000):
        integrator.predict(state, np.zeros_like(state.position_m), 1e-3)
        speeds.append(np.abs(state.velocity_m_s[:, 2]).max())
    left_s = [catheter_settling_s(rod, rod.length_m, speeds[step]) for step in (1000, 1999)]
    assert speeds[1999] < 0.5 * speeds[1000]
    assert left_s[0] - left_s[1] == pytest.approx(0.999, rel=0.01)


def test_a_step_of_force_is_a_fault_as_far_as_finer_steps_lack_it():
    start, tools = beside(), ToolInputs()
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    start.hands.write(0, tools)
    simulation.step(tools)
    way_n = np.array([[0.0, 0.0, 0.0], [0.0, 0.6, 0.0], [0.8, 0.6, 0.0]])
    for force_n, step_n, is_sudden in (((0.4, 0.6, 0.0), 0.0, False), ((0.4, 1.0, 0.0), 0.4, True)):
        watch = Watch(simulation, 0.1, {(1, 0): way_n})
        push_a_contact(simulation)
        simulation.contact_force_n[0] = force_n
        watch.look(1e-3, None)
        assert watch.worst["force_step"] == pytest.approx(step_n, abs=1e-12)
        assert watch.sudden == [(1, 0)] * is_sudden


def again(start, hands, ticks):
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    return finely.FineTicks(simulation, hands, 1e-3).forces_n(ticks)


def test_a_tick_in_parts_begins_with_what_the_run_had(monkeypatch):
    """In one part it is the run's own to the last bit, in sixteenths it is nearly that."""
    start, tools = threaded(), ToolInputs()
    way_m = least_jerk(5e-3, np.array([0.0, 0.0, 1.0]), 0.1)
    hands, step = start.hands.then(100).moved(0, way_m, LEAD_STEPS), LEAD_STEPS + 60
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    for k in range(step + 1):
        hands.write(k, tools)
        simulation.step(tools)
    force_n = finely.contact_forces_n(simulation)
    assert np.abs(force_n).max() > 0.05
    fine_n = again(start, hands, [step - 30, step])[step]
    assert fine_n.shape == (2 * finely.PARTS, 2, 3)
    assert np.abs(fine_n[finely.PARTS - 1] - force_n).max() < 0.03
    monkeypatch.setattr(finely, "PARTS", 1)
    one_n = again(start, hands, [step - 30, step])[step]
    assert np.array_equal(one_n[0], force_n)
