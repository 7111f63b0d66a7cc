"""Every criterion sees what it is for: a state is spoilt on purpose, and the figure of that fault fails."""

from dataclasses import replace

import numpy as np
import pytest

from services.mechanics.bodies.catheter import initial_state, rod_properties
from services.mechanics.contact.laws import HAS_GAP
from services.mechanics.reduction import ModalState, Newmark
from services.mechanics.rod import Supports, build_integrator
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from studies.stability.criteria import CRITERIA, REST_S, failures
from studies.stability.drive import Play, catheter_settling_s, drive, reduced_duct, wall_settling_s
from studies.stability.situations import beside, threaded
from studies.stability.watch import Watch


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
    """What the limiter of the reported force does not let through is seen all the same."""
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
        (press, "felt_step"),
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


def test_jaws_are_as_deep_in_a_wall_that_they_squeeze_as_it_is_less_thick():
    start, tools = threaded(), ToolInputs()
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    hands = start.hands.with_jaws(1, np.linspace(1.15, 0.25, 150), 20)
    for step in range(170):
        hands.write(step, tools)
        simulation.step(tools)
    rows = simulation.contacts
    n = rows.n_contacts
    in_jaws = (rows.tool[:n] == 1) & np.array(HAS_GAP)[rows.law[:n]]
    thinner, overlap = rows.pad_m[:n] * in_jaws, -rows.gap_m[:n] * in_jaws
    assert thinner.max() > 0.1e-3

    def found():
        watch = Watch(simulation, 0.1)
        watch.look(1e-3, None)
        return watch.worst["tool_penetration"]

    assert found() == pytest.approx((overlap - thinner).max(), abs=1e-9)
    assert found() < overlap.max() - 0.05e-3
    simulation.tools.pad_m[1] = 1e-3  # what a caller lets jaws hold that are in it is no squeezed wall
    assert found() == pytest.approx(overlap.max(), abs=1e-9)


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
    settling_s = catheter_settling_s(rod)
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
