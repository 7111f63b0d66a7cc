"""The insertion, and the one that misses, as the hands of a trainee would do them, in process."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics import scenarios
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.effects.mucus_drag import MucusDragSettings
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.studies.energy_book import EnergyBook
from trocar.studies.paper_scene import paper_scene


class Course:
    """What happened in every tick of a scenario."""

    def __init__(self, scenario, duct, keep_books=False):
        self.simulation = simulation = Simulation(scenario.scene, duct)
        tools = ToolInputs()
        scenario.write_inputs(0.0, tools)
        simulation.step(tools)
        self.book = EnergyBook(simulation) if keep_books else None
        self.force, self.penetration, self.imbalance, self.tips, self.shortening = [], [], [], [], []
        self.friction_power = []
        for tick in range(round(scenario.duration_s * 1000)):
            scenario.write_inputs(1e-3 * tick, tools)
            if self.book:
                self.book.step(tools)
            else:
                simulation.step(tools)
            self._note(simulation)

    def _note(self, simulation):
        self.force.append(simulation.tool_results.force_n.copy())
        self.penetration.append(simulation.max_penetration_m)
        self.tips.append(simulation.catheter.state.position_m[-1].copy())
        on_duct = simulation.duct.load_force_n[: simulation.duct.n_loads].sum(axis=0)
        rows = simulation.contacts
        on_tools = simulation.contact_force_n[rows.tool[: rows.n_contacts] >= 0].sum(axis=0)
        on_rod = simulation.catheter.contact_force_n.sum(axis=0)
        by_seal = simulation.contact_force_n[list(simulation.seal.rows)].sum(axis=0)
        self.imbalance.append(np.abs(on_duct + on_rod + on_tools - by_seal).max())
        pressed = rows.law[: rows.n_contacts] == number_of("unilateral")
        n = rows.n_contacts
        motion = simulation.system.motion_m.reshape(-1, 3) - rows.softness_m_n[:n] * rows.force_n[:n]
        self.friction_power.append(np.sum(rows.force_n[: rows.n_contacts][pressed][:, 1:] * motion[pressed][:, 1:]))
        held = simulation.holds.arrays.target[: len(simulation.holds.active)].tolist()
        x = simulation.catheter.state.position_m[min(held, default=0) :]
        arc = np.linalg.norm(np.diff(x, axis=0), axis=1).sum()
        self.shortening.append(arc - np.linalg.norm(x[-1] - x[0]) if held else 0.0)


@pytest.fixture(scope="module")
def insertion(insertion_duct):
    return Course(scenarios.insertion(), insertion_duct, keep_books=True)


def test_catheter_is_20_mm_in_the_duct_at_the_end(insertion):
    assert insertion.simulation.inserted_length_m >= 20e-3
    assert insertion.simulation.inside[-8:].all()


def test_no_particle_is_ever_deeper_than_100_um_in_the_wall(insertion):
    assert 0.0 < max(insertion.penetration) < 0.1e-3


def test_a_film_of_mucus_is_no_penetration(insertion_duct):
    scenario = scenarios.insertion()
    scene = replace(scenario.scene, effects={**scenario.scene.effects, "mucus_drag": MucusDragSettings()})
    course = Course(replace(scenario, scene=scene), insertion_duct)
    assert course.simulation.inserted_length_m >= 20e-3
    assert 0.0 < max(course.penetration) < 0.1e-3


@pytest.mark.long
def test_a_hand_four_times_slower_ends_at_the_same_place(insertion, insertion_duct):
    """What it costs, resists and reaches is quasi-static."""
    fast = scenarios.insertion()
    motions = tuple(replace(m, time_s=tuple(4.0 * t for t in m.time_s)) for m in fast.motions)
    slow = Course(replace(fast, motions=motions, duration_s=4.0 * fast.duration_s), insertion_duct)
    assert np.linalg.norm(slow.tips[-1] - insertion.tips[-1]) < 0.1e-3
    assert 0.0 < max(slow.penetration) < 0.1e-3


def test_forces_are_continuous_and_felt_by_both_hands(insertion):
    force = np.array(insertion.force)
    assert np.linalg.norm(np.diff(force, axis=0), axis=2).max() < 0.3
    assert np.linalg.norm(force, axis=2).max(axis=0).min() > 2e-3
    assert insertion.simulation.tool_results.grasp_torque_nm[0] > 5e-3


def test_every_action_has_its_reaction_in_every_tick(insertion):
    assert max(insertion.imbalance) < 1e-9


def test_energy_books_balance_to_one_percent(insertion):
    flow = insertion.book.flow
    assert flow.input_j > 1e-4
    assert abs(flow.imbalance_j) < 0.01 * flow.input_j


def test_friction_never_feeds_energy_in(insertion):
    """Power of friction on the sliding of each tick: not positive beyond the solver's tolerance."""
    power = np.array(insertion.friction_power)
    assert power.min() < -1e-9
    assert power.max() < 1e-4 * abs(power.min())
    assert insertion.book.flow.friction_j > 0.0


def test_aiming_beside_the_mouth_pushes_on_the_outside_and_buckles(insertion_duct):
    scenario = scenarios.miss()
    course = Course(scenario, insertion_duct)
    assert course.simulation.inserted_length_m == 0.0
    assert max(course.penetration) < 0.1e-3
    force = np.array(course.force)
    assert np.linalg.norm(force[:, 0], axis=1).max() > 0.02
    assert np.linalg.norm(np.diff(force, axis=0), axis=2).max() < 0.3
    # 18 mm of catheter were pushed forward and the free length of 30 mm bowed out.
    assert max(course.shortening) > 1e-3


@pytest.mark.parametrize("name", scenarios.SCENARIOS)
def test_scripted_hands_move_without_jumps(name):
    scenario = scenarios.SCENARIOS[name]()
    tools, places = ToolInputs(), []
    for tick in range(0, round(1000 * scenario.duration_s)):
        scenario.write_inputs(1e-3 * tick, tools)
        places.append(tools.position_m.ravel().copy())
    speed = np.diff(places, axis=0) / 1e-3
    assert np.abs(speed).max() < 0.3
    assert np.abs(np.diff(speed, axis=0)).max() < 4e-3


def test_the_papers_scene_runs(cache_dir):
    scene = paper_scene()
    hands = scenarios.insertion()
    duct = build_scene_duct(scene, cache_dir)
    simulation, tools = Simulation(scene, duct), ToolInputs()
    for tick in range(1700):
        hands.write_inputs(1e-3 * tick, tools)
        simulation.step(tools)
    assert len(simulation.holds.active) == 2
    assert simulation.inserted_length_m > 15e-3
    assert np.abs(simulation.tool_results.force_n[1]).max() > 1e-4
