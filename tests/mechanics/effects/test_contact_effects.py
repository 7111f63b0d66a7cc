"""Effects in contacts: friction, the film of mucus, slipping grasps, stones."""

from dataclasses import replace

import numpy as np
import pytest
from effect_runs import run

from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.runtime.errors import ConfigError


def test_friction_holds_the_catheter_on_a_slope_below_its_angle_and_not_above(with_effects, small_duct):
    """Gravity tilted against the wall: slides when tan(tilt) exceeds mu, sticks when it does not."""
    moved = {}
    for mu in (0.2, 0.5):
        tilt = np.arctan(0.35)
        g = 9.81 * np.array([-np.sin(tilt), 0.0, -np.cos(tilt)])
        scene = with_effects(gravity={"acceleration_m_s2": tuple(g)}, friction={"mu_static": mu, "mu_kinetic": mu})
        catheter = replace(
            scene.catheter, anchor="free", length_m=20e-3, n_segments=10, tip_position_m=(10e-3, 0.0, -2.6e-3)
        )
        simulation = run(replace(scene, catheter=catheter), small_duct, ticks=60)
        start = simulation.catheter.state.position_m[:, 0].mean()
        tools = ToolInputs()
        tools.present[:] = False
        for _ in range(40):
            simulation.step(tools)
        moved[mu] = start - simulation.catheter.state.position_m[:, 0].mean()
    assert moved[0.2] > 5e-4
    assert abs(moved[0.5]) < 5e-5


def test_mucus_film_drags_with_the_couette_force(with_effects, small_duct):
    """A catheter sliding along the wall with a film is slower than without, by the same force on the duct."""
    speeds = {}
    for effects in ({}, {"mucus_drag": {}}):
        scene = with_effects(gravity={"acceleration_m_s2": (-2.0, 0.0, -9.81)}, **effects)
        catheter = replace(
            scene.catheter, anchor="free", length_m=20e-3, n_segments=10, tip_position_m=(10e-3, 0.0, -2.6e-3)
        )
        simulation = run(replace(scene, catheter=catheter), small_duct, ticks=60)
        speeds[len(effects)] = -simulation.catheter.state.velocity_m_s[:, 0].mean()
        on_duct = simulation.duct.load_force_n[: simulation.duct.n_loads].sum(axis=0)
        assert np.abs(on_duct + simulation.catheter.contact_force_n.sum(axis=0)).max() < 1e-12
    assert 0.0 < speeds[1] < 0.2 * speeds[0]


def test_a_stone_that_flies_at_the_catheter_at_more_than_a_metre_a_second_meets_it(with_effects, small_duct):
    """Before, it was looked for within half a millimetre, at any speed, and was 0.4 mm inside in the next tick."""
    simulation, tools = Simulation(with_effects(gallstones={}), small_duct), ToolInputs()
    tools.present[:] = False
    stone, rod = simulation.effects["gallstones"], simulation.catheter
    apart_m = stone.radius_m[0] + rod.radius_m
    stone.position_m[0] = rod.state.position_m[15] + [0.0, apart_m + 0.8e-3, 0.0]
    stone.velocity_m_s[0] = 0.0, -1.2, 0.0
    for _ in range(5):
        simulation.step(tools)
        away_m = np.linalg.norm(rod.state.position_m[10:20] - stone.position_m[0], axis=1).min()
        assert away_m > apart_m - 50e-6
    assert stone.velocity_m_s[0, 1] > -1.0


def test_a_stone_that_the_catheter_drives_into_the_wall_within_a_step_meets_it(with_effects, small_duct):
    """Before, what was struck at rest was looked for within half a millimetre of where it lay."""
    radius_m, gap_m, speed_m_s = 1e-3, 0.6e-3, 0.95  # a step takes it 0.95 mm, and is taken in parts from 1 mm on
    scene = with_effects(gallstones={"position_m": ((20e-3, 0.0, 0.0),), "radius_m": (radius_m,)})
    apart_m = radius_m + 0.5 * scene.catheter.outer_diameter_m
    stone_m = scene.duct.radius_m - 0.5 * scene.duct.thickness_m - gap_m - radius_m
    tip_m = (10e-3, stone_m - apart_m, 0.0)
    catheter = replace(scene.catheter, anchor="free", length_m=20e-3, n_segments=10, tip_position_m=tip_m)
    simulation, tools = Simulation(replace(scene, catheter=catheter), small_duct), ToolInputs()
    tools.present[:] = False
    stone, rod = simulation.effects["gallstones"], simulation.catheter
    stone.position_m[0] = rod.state.position_m[5] + [0.0, apart_m, 0.0]
    rod.state.velocity_m_s[:, 1] = speed_m_s
    deepest_m = 0.0
    for _ in range(5):
        simulation.step(tools)
        rows = simulation.contacts
        mine = rows.stone[: rows.n_contacts] == 0
        deepest_m = max(deepest_m, -rows.gap_m[: rows.n_contacts][mine].min(initial=0.0))
    assert deepest_m < 50e-6


def test_stone_falls_onto_the_wall_and_rests_with_its_weight(with_effects, small_duct):
    scene = with_effects(
        gravity={},
        gallstones={"position_m": ((10e-3, 0.0, -1.5e-3),), "radius_m": (1.5e-3,), "density_kg_m3": 2000.0},
    )
    simulation = run(scene, small_duct, ticks=400)
    stone = simulation.effects["gallstones"]
    assert np.abs(stone.velocity_m_s).max() < 2e-3
    weight = (2000.0 - 1000.0) * 4.0 / 3.0 * np.pi * 1.5e-3**3 * 9.81
    tools, carried = ToolInputs(), []
    tools.present[:] = False
    for _ in range(100):
        simulation.step(tools)
        mine = simulation.contacts.stone[: simulation.contacts.n_contacts] == 0
        carried.append(simulation.contact_force_n[mine].sum(axis=0)[2])
    assert np.mean(carried) == pytest.approx(weight, rel=0.05)
    assert -4e-3 < stone.position_m[0, 2] < -1.5e-3


@pytest.mark.parametrize("model", ["implicit", "penalty"])
@pytest.mark.parametrize("viscosity_pa_s", [3e-3, 6e-3])
@pytest.mark.parametrize("angle_rad", [np.pi / 12, 0.0], ids=["facet", "fold"])
def test_a_film_slows_a_sliding_catheter_by_its_viscosity_under_either_contact_model(
    with_effects, small_duct, model, viscosity_pa_s, angle_rad
):
    """Off the wall, M dV/dt = -n b V with b = viscosity * length * diameter / film: near one facet as between two."""
    scene = with_effects(mucus_drag={"viscosity_pa_s": viscosity_pa_s})
    catheter = replace(
        scene.catheter,
        anchor="free",
        length_m=20e-3,
        n_segments=10,
        tip_position_m=(10e-3, -2.35e-3 * np.sin(angle_rad), -2.35e-3 * np.cos(angle_rad)),
        viscous_drag_n_s_m2=0.0,
    )
    contact = replace(scene.contact, model=model, penalty_stiffness_n_m=1.0)
    simulation = Simulation(replace(scene, catheter=catheter, contact=contact), small_duct)
    tools, state = ToolInputs(), simulation.catheter.state
    tools.present[:] = False
    state.velocity_m_s[:, 0] = -20e-3
    for _ in range(50):
        simulation.step(tools)
    b_n_s_m = viscosity_pa_s * 2e-3 * scene.catheter.outer_diameter_m / 0.3e-3
    mass_kg = simulation.catheter.properties.particle_mass_kg()
    left = mass_kg @ state.velocity_m_s[:, 0] / (-20e-3 * mass_kg.sum())
    assert left == pytest.approx(np.exp(-50e-3 * 11 * b_n_s_m / mass_kg.sum()), rel=0.03)


def test_a_film_reaches_no_further_than_it_is_thick(with_effects, small_duct):
    """0.43 mm from the wall, where detection already looks, a film of 0.3 mm drags nothing."""
    out = 2.1e-3 * np.array([np.sin(np.pi / 12), np.cos(np.pi / 12)])
    catheter = {"anchor": "free", "length_m": 20e-3, "n_segments": 10, "viscous_drag_n_s_m2": 0.0}
    catheter["tip_position_m"] = (10e-3, *(-out))
    speeds_m_s = {}
    for film_m in (0.3e-3, 0.45e-3):
        scene = with_effects(mucus_drag={"film_m": film_m})
        simulation = Simulation(replace(scene, catheter=replace(scene.catheter, **catheter)), small_duct)
        tools, state = ToolInputs(), simulation.catheter.state
        tools.present[:] = False
        state.velocity_m_s[:, 0] = -20e-3
        for _ in range(20):
            simulation.step(tools)
        speeds_m_s[film_m] = -state.velocity_m_s[:, 0].mean()
    assert speeds_m_s[0.3e-3] == pytest.approx(20e-3, rel=1e-6)
    assert speeds_m_s[0.45e-3] < 1e-3


def test_a_film_thicker_than_the_margin_of_detection_is_refused(with_effects):
    with pytest.raises(ConfigError, match=r"film_m: 0\.0006 m is more than contact\.margin_m, 0\.0005 m"):
        with_effects(mucus_drag={"film_m": 0.6e-3})


def pull_at_the_catheter(with_effects, small_duct, effects, limit_n=0.05):
    """Both holds of a grasp on the catheter, the hand 5 mm away: through the coupling that would be 2.5 N."""
    simulation, tools = Simulation(with_effects(**effects), small_duct), ToolInputs()
    tools.present[0] = False
    at = simulation.catheter.state.position_m[10].copy()
    tools.holds = [
        GraspHold(number, 1, CATHETER_SEGMENT, 10, np.array([1.0 - s, s, 0.0]), limit_n, 0.3)
        for number, s in ((1, 0.0), (2, 0.5))
    ]
    largest_n = 0.0
    for tick in range(150):
        tools.position_m[1] = at + np.array([0.0, 0.0, 8e-3]) + min(tick, 100) * np.array([0.0, 5e-5, 0.0])
        simulation.step(tools)
        rows = simulation.contacts
        held = rows.law[: rows.n_contacts] == number_of("grip")
        in_their_plane_n = rows.force_n[: rows.n_contacts][held, 1:]
        largest_n = max(largest_n, np.linalg.norm(in_their_plane_n, axis=1).max(initial=0.0))
    return simulation, largest_n


def test_a_grasp_slips_at_its_grip_friction_and_not_without_the_effect(with_effects, small_duct):
    slips, slipping_n = pull_at_the_catheter(with_effects, small_duct, {"grasp_slip": {}})
    sticks, sticking_n = pull_at_the_catheter(with_effects, small_duct, {})
    assert slipping_n == pytest.approx(0.05, rel=1e-6)
    assert slips.holds.dissipated_j > 0.0
    assert sticking_n > 0.1
    assert sticks.holds.dissipated_j == 0.0


def test_holds_have_their_row_where_rows_run_out_and_leave_the_friction_of_others_alone(with_effects, small_duct):
    """Room for them is kept free: without a row a hold would stretch unfelt. Nobody else gets their newtons."""
    scene = with_effects(friction={}, grasp_slip={}, gravity={})
    catheter = replace(
        scene.catheter, anchor="free", length_m=20e-3, n_segments=10, tip_position_m=(10e-3, 0.0, -2.6e-3)
    )
    scene = replace(scene, catheter=catheter, contact=replace(scene.contact, capacity=7))
    simulation, tools = Simulation(scene, small_duct), ToolInputs()
    tools.present[0] = False
    tools.position_m[1] = 60e-3, 0.0, 30e-3
    tools.holds = [GraspHold(1, 1, CATHETER_SEGMENT, 0, np.array([1.0, 0.0, 0.0]), 7.0, 0.3)]
    for _ in range(60):
        simulation.step(tools)
    rows = simulation.contacts
    assert rows.n_contacts == rows.capacity
    is_hold = rows.law == number_of("grip")
    assert is_hold.sum() == 1
    assert set(rows.friction[~is_hold]) <= {0.12, 0.08}
    assert np.isinf(rows.force_limit_n[~is_hold]).all()
