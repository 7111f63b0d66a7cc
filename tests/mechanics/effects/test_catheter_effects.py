"""Effects on the catheter: its weight, its torsion, itself."""

from dataclasses import replace

import numpy as np
import pytest
from effect_runs import run

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation


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


def test_catheter_does_not_pass_through_itself(with_effects, small_duct):
    """Two parallel strands of a loop fall on each other, before it opens."""
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
        state.velocity_m_s[20:, 2] = -1.5
        tools = ToolInputs()
        tools.present[:] = False
        gaps[len(effects)] = np.inf
        for _ in range(3):
            simulation.step(tools)
            x = state.position_m
            nearest = min(np.linalg.norm(x[i] - x[j]) for i in range(41) for j in range(i + 12, 41))
            gaps[len(effects)] = min(gaps[len(effects)], nearest)
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
    assert simulation.healed_states == 0


def test_twist_gives_the_catheter_the_torsional_stiffness_of_its_tube(with_effects, small_duct):
    """GJ = E / (2 (1 + nu)) * pi (d_o^4 - d_i^4) / 32."""
    simulation = run(with_effects(twist={}), small_duct, ticks=1)
    tube = simulation.scene.catheter
    shear_pa = tube.youngs_modulus_pa / (2.0 * (1.0 + tube.poisson_ratio))
    polar_m4 = np.pi / 32.0 * (tube.outer_diameter_m**4 - tube.inner_diameter_m**4)
    assert simulation.catheter.properties.torsional_stiffness_n_m2 == pytest.approx(shear_pa * polar_m4)
    assert simulation.catheter.state.frame is not None
