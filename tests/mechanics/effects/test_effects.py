from dataclasses import replace

import numpy as np
import pytest

from services.mechanics.effects import EFFECTS, build_effects
from services.mechanics.effects.base import NoSettings
from services.mechanics.effects.friction import FrictionSettings
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.scene_duct import build_scene_duct


def run(scene, duct, ticks=60, tools=None):
    simulation = Simulation(scene, duct)
    if tools is None:
        tools = ToolInputs()
        tools.present[:] = False
    for _ in range(ticks):
        simulation.step(tools)
    return simulation


def state(simulation):
    rod = simulation.catheter.state
    return np.concatenate([simulation.duct.state.q, rod.position_m.ravel(), rod.velocity_m_s.ravel()])


def pressing_tools(small_scene):
    tools = ToolInputs()
    tools.present[1] = False
    tools.position_m[0] = 20e-3, 0.0, 15e-3 + 3.5e-3
    return tools


def test_table_names_what_each_effect_is_and_where_it_acts():
    for name, entry in EFFECTS.items():
        assert entry.what
        assert entry.stages, f"{name} acts nowhere"


def test_absent_effects_do_not_exist(with_effects, small_duct):
    simulation = Simulation(with_effects(), small_duct)
    assert simulation.effects == {}
    assert not any(simulation._stages.values())
    assert simulation.catheter.properties.torsional_stiffness_n_m2 is None


def test_unknown_effects_and_settings_of_another_are_refused_by_name(small_scene):
    with pytest.raises(ValueError, match=r"effects.gravitas: there is no such effect; known: .*gravity"):
        build_effects(replace(small_scene, effects={"gravitas": NoSettings()}))
    with pytest.raises(ValueError, match=r"effects.friction: takes FrictionSettings, not dict"):
        build_effects(replace(small_scene, effects={"friction": {"mu_static": 0.1}}))
    with pytest.raises(ValueError, match=r"kinetic friction 0.5 is not within 0 and static 0.1"):
        FrictionSettings(mu_kinetic=0.5, mu_static=0.1)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("gravity", {"acceleration_m_s2": (0.0, 0.0, 0.0)}),
        ("friction", {"mu_static": 0.0, "mu_kinetic": 0.0, "tool_mu_static": 0.0, "tool_mu_kinetic": 0.0}),
        ("grasp_slip", {}),
        ("self_contact", {}),
    ],
)
def test_effect_with_nothing_to_do_is_bit_identical_to_none(with_effects, small_duct, name, settings):
    tools = pressing_tools(None)
    bare = state(run(with_effects(), small_duct, tools=tools))
    idle = state(run(with_effects(**{name: settings}), small_duct, tools=tools))
    assert np.abs(bare).max() > 0.0
    assert np.array_equal(bare, idle)


def test_catheter_hangs_as_a_cantilever_under_its_weight(with_effects, small_duct):
    """A short, stiff overhang out of the introducer's mouth: w L^4 / 8 EI with a clamped root."""
    scene = with_effects(gravity={})
    catheter = replace(
        scene.catheter,
        anchor="clamped",
        tip_position_m=(60e-3, 40e-3, 0.0),
        length_m=40e-3,
        n_segments=40,
        viscous_drag_n_s_m2=2.0,
    )
    simulation = run(replace(scene, catheter=catheter), small_duct, ticks=400)
    properties = simulation.catheter.properties
    weight = 9.81 * properties.linear_density_kg_m
    expected = weight * 40e-3**4 / 8.0 / properties.bending_stiffness_n_m2
    assert -simulation.catheter.state.position_m[-1, 2] == pytest.approx(expected, rel=0.01)


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


def test_insufflation_moves_the_wall_by_the_static_solution(with_effects, small_scene, cache_dir):
    """Rest shape plus modes at equilibrium is the full static solution; the step leaves it alone."""
    scene = with_effects(insufflation={"outside_pa": 0.0, "inside_pa": 100.0})
    duct = build_scene_duct(scene, cache_dir)
    simulation = run(scene, duct, ticks=20)
    bare = build_scene_duct(small_scene, cache_dir)
    shape = duct.mesh.vertices_m + duct.basis.displacements(simulation.duct.state.q)
    middle = np.abs(bare.mesh.vertices_m[:, 0] - 20e-3) < 2e-3
    grown = np.linalg.norm(shape[middle, 1:], axis=1) - np.linalg.norm(bare.mesh.vertices_m[middle, 1:], axis=1)
    # p R^2 / (E t) for a thin tube free at one end.
    expected = 100.0 * 4e-3**2 / (300e3 * 1e-3)
    assert grown.mean() == pytest.approx(expected, rel=0.1)
    assert np.abs(simulation.duct.state.qdot).max() < 1e-12


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
        on_duct = simulation.load_force_n[: simulation.n_loads].sum(axis=0)
        assert np.abs(on_duct + simulation.catheter.contact_force_n.sum(axis=0)).max() < 1e-12
    assert 0.0 < speeds[1] < 0.2 * speeds[0]


def test_catheter_does_not_pass_through_itself(with_effects, small_duct):
    """Two parallel strands of a loop fall on each other."""
    gaps = {}
    for effects in ({}, {"self_contact": {}}):
        scene = with_effects(**effects)
        catheter = replace(scene.catheter, anchor="free", tip_position_m=(100e-3, 50e-3, 0.0), n_segments=40)
        simulation = Simulation(replace(scene, catheter=catheter), small_duct)
        state = simulation.catheter.state
        angle = np.linspace(0.0, 2.3 * np.pi, 41)
        radius = 0.1 / (2.3 * np.pi)
        state.position_m[:] = np.stack(
            [0.1 + radius * np.cos(angle), 0.1 + radius * np.sin(angle), 0.4e-3 * angle], axis=1
        )
        state.velocity_m_s[20:, 2] = -0.5
        tools = ToolInputs()
        tools.present[:] = False
        for _ in range(6):
            simulation.step(tools)
        x = state.position_m
        gaps[len(effects)] = min(np.linalg.norm(x[i] - x[j]) for i in range(41) for j in range(i + 12, 41))
    diameter = 1.67e-3
    assert gaps[1] > 0.9 * diameter
    assert gaps[0] < gaps[1]


def test_strands_pressed_into_each_other_come_out_where_they_went_in(with_effects, small_duct):
    """The closest points of the axes alone would say the other side, once the axes have crossed."""
    scene = with_effects(self_contact={})
    catheter = replace(scene.catheter, anchor="free", tip_position_m=(100e-3, 50e-3, 0.0), n_segments=40)
    simulation = Simulation(replace(scene, catheter=catheter), small_duct)
    state, tools = simulation.catheter.state, ToolInputs()
    tools.present[:] = False
    along = np.linspace(0.0, 1.0, 18)[:, None]
    bend = np.pi * (np.linspace(0.0, 1.0, 7)[1:-1, None] - 0.5)
    far = 0.1 + 17 * 2.5e-3
    there = np.hstack([0.1 + 17 * 2.5e-3 * along, np.full_like(along, 0.1), np.zeros_like(along)])
    turn = np.hstack([far + 5e-3 * np.cos(bend), 0.105 + 5e-3 * np.sin(bend), np.zeros_like(bend)])
    state.position_m[:] = np.vstack([there, turn, there[::-1]])
    back = slice(23, 41)
    state.position_m[back, 2] = 1.7e-3
    simulation.step(tools)
    state.position_m[back, 2] = -0.2e-3
    state.velocity_m_s[:] = 0.0
    lowest = []
    for _ in range(20):
        simulation.step(tools)
        lowest.append(np.mean(state.position_m[back, 2] - state.position_m[17::-1, 2]))
    assert lowest[-1] > 1e-3


@pytest.mark.parametrize("name", ["viscoelasticity", "nonlinear_membrane", "twist"])
def test_body_effects_run_with_the_contacts(with_effects, small_duct, name):
    tools = pressing_tools(None)
    simulation = run(with_effects(**{name: {}}), small_duct, tools=tools, ticks=120)
    assert np.isfinite(state(simulation)).all()
    assert simulation.tool_results.force_n[0, 2] > 0.0


def test_a_catheter_with_rest_curvature_bends_to_a_ring_of_that_curvature(with_effects, small_duct):
    """1/R along all joints, clamped and free of other loads."""
    scene = with_effects(twist={})
    rest = ((0.0, 20.0, 0.0),) * 29
    catheter = replace(scene.catheter, anchor="clamped", tip_position_m=(0.2, 40e-3, 0.0), rest_curvature_1_m=rest)
    catheter = replace(catheter, viscous_drag_n_s_m2=0.5, internal_damping_s=2e-3)
    x = run(replace(scene, catheter=catheter), small_duct, ticks=1000).catheter.state.position_m
    edges = np.diff(x, axis=0)
    turned = np.arctan2(np.linalg.norm(np.cross(edges[5], edges[-5])), edges[5] @ edges[-5])
    assert turned == pytest.approx(20.0 * 20 * 0.1 / 30, rel=0.01)


def test_rest_curvature_without_a_frame_to_turn_with_is_refused(with_effects, small_duct):
    scene = with_effects()
    scene = replace(scene, catheter=replace(scene.catheter, rest_curvature_1_m=((0.0, 20.0, 0.0),) * 29))
    with pytest.raises(ValueError, match=r"catheter.rest_curvature_1_m: .*effect 'twist'"):
        Simulation(scene, small_duct)


def test_viscoelastic_wall_relaxes_under_a_held_tool(with_effects, small_duct):
    """Pressed and held for 0.3 s, the force falls; the elastic wall's does not."""
    fall = {}
    for effects in ({}, {"viscoelasticity": {"g": (0.4,), "tau_s": (0.05,)}}):
        simulation = Simulation(with_effects(**effects), small_duct)
        tools = pressing_tools(None)
        forces = []
        for _ in range(400):
            simulation.step(tools)
            forces.append(simulation.tool_results.force_n[0, 2])
        fall[len(effects)] = np.mean(forces[60:80]) / np.mean(forces[-20:])
    assert fall[1] > 1.1 * fall[0]


def test_anisotropic_wall_has_other_modes(with_effects, cache_dir, small_duct):
    stiff_round = build_scene_duct(with_effects(anisotropy={}), cache_dir)
    assert stiff_round.basis.content_hash != small_duct.basis.content_hash
    assert stiff_round.basis.omega_rad_s[-1] > 1.1 * small_duct.basis.omega_rad_s[-1]


def test_sleeping_catheter_costs_its_motion_nothing_and_wakes_without_a_jump(with_effects, small_duct):
    """Hung until still, asleep for a while, then touched: the same course as one that never sleeps."""
    courses, aside = {}, {"tip_position_m": (60e-3, 40e-3, 0.0)}
    for sleeping in (True, False):
        scene = replace(with_effects(gravity={}), sleeping=sleeping)
        scene = replace(scene, catheter=replace(scene.catheter, anchor="clamped", viscous_drag_n_s_m2=0.2, **aside))
        simulation = run(scene, small_duct, ticks=1500)
        assert simulation.catheter.is_asleep() == sleeping
        tools, places = ToolInputs(), []
        tools.present[1] = False
        tools.jaw_angle_rad[:] = 0.3
        for tick in range(300):
            tools.position_m[0] = 65e-3, 40e-3, 15e-3 - 6e-5 * tick
            simulation.step(tools)
            places.append(simulation.catheter.state.position_m.copy())
        courses[sleeping] = np.array(places)
    assert np.abs(courses[True] - courses[True][0]).max() > 1e-4
    assert np.abs(courses[True] - courses[False]).max() < 1e-6
    assert np.abs(np.diff(courses[True], axis=0)).max() < 1e-4
