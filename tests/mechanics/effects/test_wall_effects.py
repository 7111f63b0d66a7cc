"""Effects on the duct's wall: loads, and what it is made of."""

from dataclasses import replace

import numpy as np
import pytest
from effect_runs import PRESSED_M, come_down, run

from trocar.services.mechanics.bodies import wall_terms
from trocar.services.mechanics.bodies.wall_terms import conjugate_energy, terms_of
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.mechanics.surface.mesh import vertex_areas_m2
from trocar.studies.energy_book import EnergyBook

NEAR_CLAMP_M = (7e-3, 0.0, 15e-3 + 4.4e-3)


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


def test_viscoelastic_wall_relaxes_under_a_held_tool(with_effects, small_duct):
    """Pressed and held for 0.3 s, the force falls; the elastic wall's does not."""
    fall = {}
    for effects in ({}, {"viscoelasticity": {"g": (0.4,), "tau_s": (0.1,)}}):
        simulation = Simulation(with_effects(**effects), small_duct)
        tools = come_down(simulation)
        forces = []
        for _ in range(400):
            simulation.step(tools)
            forces.append(simulation.tool_results.force_n[0, 2])
        fall[len(effects)] = np.mean(forces[20:40]) / np.mean(forces[-20:])
    assert fall[1] > 1.1 * fall[0]


def test_a_dent_relaxes_as_the_whole_wall_does(with_effects, cache_dir):
    """Few modes leave most of a poke to the residual: held, the wall's stiffness still falls to the lasting modulus."""
    stiffness = []
    for effects in ({"viscoelasticity": {"g": (0.4,), "tau_s": (0.05,)}}, {}):
        scene = with_effects(**effects)
        scene = replace(scene, duct=replace(scene.duct, n_modes=4))
        simulation = Simulation(scene, build_scene_duct(scene, cache_dir))
        wall = simulation.duct.surface_m()
        tools = come_down(simulation, NEAR_CLAMP_M)  # a small dent, with the same contacts both times
        for _ in range(900):
            simulation.step(tools)
        dent_m = np.linalg.norm(simulation.duct.surface_m() - wall, axis=1)[wall[:, 0] < 12e-3].max()
        stiffness.append(simulation.tool_results.force_n[0, 2] / dent_m)
    assert stiffness[0] == pytest.approx(0.6 * stiffness[1], rel=0.01)


def test_a_dent_is_where_the_full_model_says_while_it_relaxes(with_effects, cache_dir):
    """From the contact forces f of every tick: K u = p where all relaxes alike, p = f + sum g h, h' = (p - h) / tau."""
    g, tau_s = np.array([0.3, 0.2]), np.array([0.3, 1.5])
    scene = with_effects(viscoelasticity={"g": tuple(g), "tau_s": tuple(tau_s)})
    duct = build_scene_duct(replace(scene, duct=replace(scene.duct, n_modes=4)), cache_dir)
    simulation, tools = Simulation(scene, duct), ToolInputs()
    tools.present[1] = False
    model, wall = duct.recipe.model(), simulation.duct.surface_m()
    lag, acting = np.zeros((2, *wall.shape)), np.zeros(wall.shape)
    for tick in range(1, 1001):
        tools.position_m[0] = np.add(NEAR_CLAMP_M, (0.0, 0.0, 4e-3 * max(1.0 - tick / 80.0, 0.0)))
        simulation.step(tools)
        nodes, shares = simulation.contacts.on_duct
        acting[:] = np.tensordot(g, lag, 1)
        np.add.at(acting, nodes, -shares[:, :, None] * np.array(simulation.contact_force_n)[: len(nodes), None])
        lag += (1.0 - np.exp(-1e-3 / tau_s))[:, None, None] * (acting - lag)
        if tick in (300, 600, 1000):  # swings of the first touch are over
            moved_m, pressed = simulation.duct.surface_m() - wall, np.unique(nodes[shares > 0.0])
            expected_m = model.solve_static(acting).displacement_m[pressed]
            np.testing.assert_allclose(moved_m[pressed], expected_m, atol=0.002 * np.abs(expected_m).max())


def test_the_books_balance_over_a_poke_that_relaxes(with_effects, cache_dir):
    scene = with_effects(viscoelasticity={})
    scene = replace(scene, duct=replace(scene.duct, n_modes=12))
    simulation, tools = Simulation(scene, build_scene_duct(scene, cache_dir)), ToolInputs()
    tools.present[1] = False
    tools.position_m[0] = np.add(PRESSED_M, (0.0, 0.0, 4e-3))
    simulation.step(tools)
    book, most_j = EnergyBook(simulation), 0.0
    for tick in range(900):
        tools.position_m[0, 2] = PRESSED_M[2] + 4e-3 - 5e-3 * max(0.0, 1.0 - abs(tick / 400.0 - 1.0))
        book.step(tools)
        most_j = max(most_j, book.flow.input_j)
    effect = simulation.effects["viscoelasticity"]
    assert effect.dissipated_j > 0.05 * most_j
    assert abs(book.flow.imbalance_j) < 0.01 * most_j


def test_what_lags_in_a_state_is_looked_for_once_however_often_a_book_asks(with_effects, small_duct, monkeypatch):
    """It takes a minimisation: drawn cases spent more time there than in their ticks."""
    scene = with_effects(nonlinear_membrane={"n_coordinates": 6}, viscoelasticity={})
    simulation, tools = Simulation(scene, small_duct), ToolInputs()
    tools.present[1] = False
    for tick in range(60):
        tools.position_m[0] = np.add(PRESSED_M, (0.0, 0.0, 4e-3 - 1e-4 * tick))
        simulation.step(tools)
    found, book = [], EnergyBook(simulation)
    monkeypatch.setattr(wall_terms, "conjugate_energy", lambda *of: found.append(of) or conjugate_energy(*of))
    book.step(tools)
    first_j = simulation.duct.terms.energy_j()
    assert len(found) == simulation.duct.viscous.d.shape[0]
    simulation.duct.viscous.d *= 0.5
    assert simulation.duct.terms.energy_j() != first_j
    assert len(found) == 2 * simulation.duct.viscous.d.shape[0]


def test_anisotropic_wall_has_other_modes(with_effects, cache_dir, small_duct):
    stiff_round = build_scene_duct(with_effects(anisotropy={}), cache_dir)
    assert stiff_round.basis.content_hash != small_duct.basis.content_hash
    assert stiff_round.basis.omega_rad_s[-1] > 1.1 * small_duct.basis.omega_rad_s[-1]


def test_a_wall_with_weight_rests_where_the_full_model_does(with_effects, small_scene, cache_dir):
    scene = with_effects(gravity={"on_duct": True})
    duct = build_scene_duct(scene, cache_dir)
    bare = build_scene_duct(small_scene, cache_dir).mesh
    simulation = run(scene, duct, ticks=5)
    weight_n = np.zeros((bare.n_vertices, 3))
    weight_n[:, 2] = -9.81 * scene.duct.density_kg_m3 * scene.duct.thickness_m * vertex_areas_m2(bare)
    expected = duct.recipe.model().solve_static(weight_n).displacement_m
    moved = duct.mesh.vertices_m + duct.basis.displacements(simulation.duct.state.q) - bare.vertices_m
    assert moved == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
    assert np.abs(expected).max() > 1e-5


def third_zero_ms(scene, duct, amplitude_m, mode=4):
    """Ticks until a mode that is let go at this amplitude has passed through rest three times."""
    simulation, tools = Simulation(scene, duct), ToolInputs()
    tools.present[:] = False
    state, zeros = simulation.duct.state, 0
    state.q[mode] = amplitude_m / np.abs(duct.basis.Phi[:, :, mode]).max()
    for tick in range(200):
        before = state.q[mode]
        simulation.step(tools)
        zeros += before * state.q[mode] < 0.0
        if zeros == 3:
            return tick
    return None


def test_a_wall_that_stiffens_rings_faster_the_further_it_swings(with_effects, small_duct):
    scene = with_effects(nonlinear_membrane={"n_coordinates": 6})
    catheter = replace(scene.catheter, anchor="free", length_m=20e-3, tip_position_m=(60e-3, 60e-3, 0.0))
    scene = replace(scene, catheter=catheter)
    duct = replace(small_duct, damping_ratio=np.full(small_duct.basis.n_modes, 0.02))
    linear = third_zero_ms(replace(scene, effects={}), duct, 8e-3)
    assert third_zero_ms(scene, duct, 0.5e-3) == linear
    assert third_zero_ms(scene, duct, 8e-3) < 0.85 * linear


def test_a_wall_that_stiffens_far_more_than_its_modes_keeps_its_energy(with_effects, small_duct):
    """Bent by eight radii in steps of a millisecond, a duct that was kicked gave out half of what was put in."""
    scene = with_effects(nonlinear_membrane={})
    duct = replace(small_duct, damping_ratio=np.zeros(small_duct.basis.n_modes))
    simulation, tools = Simulation(scene, duct), ToolInputs()
    tools.present[:] = False
    simulation.step(tools)
    state, basis = simulation.duct.state, small_duct.basis
    state.q[2] = 8e-3 / np.abs(basis.Phi[:, :, 2]).max()
    state.qddot[:] = simulation.duct.held_force - basis.omega_rad_s**2 * state.q
    began = stored_in_wall_j(simulation) + simulation.duct.kinetic_energy_j()
    for _ in range(200):
        simulation.step(tools)
    assert stored_in_wall_j(simulation) + simulation.duct.kinetic_energy_j() <= 1.005 * began


def stored_in_wall_j(simulation):
    duct = simulation.duct
    elastic_j = duct.state.strain_energy_j(duct.reduced.basis.omega_rad_s)
    return elastic_j + sum(effect.potential_energy_j(simulation.world) for effect in simulation.effects.values())


def dissipated_j(simulation):
    return sum(effect.dissipated_j for effect in simulation.effects.values())


def test_a_bent_wall_that_stiffens_relaxes_to_the_same_share_of_its_energy(with_effects, small_duct):
    """If the linear part alone relaxed, walls bent by a few radii would store less than nothing, and snap."""
    scene = with_effects(nonlinear_membrane={"n_coordinates": 6})
    elastic = Simulation(scene, small_duct)
    relaxed = Simulation(with_effects(nonlinear_membrane={"n_coordinates": 6}, viscoelasticity={}), small_duct)
    series = relaxed.scene.effects["viscoelasticity"].series()
    random = np.random.default_rng(0)
    for _ in range(20):
        q = np.zeros_like(elastic.duct.state.q)
        q[:6] = random.normal(size=6) / small_duct.basis.omega_rad_s[:6]
        q *= random.uniform(4e-3, 16e-3) / np.linalg.norm(small_duct.basis.displacements(q), axis=1).max()
        for each in (elastic, relaxed):
            each.duct.state.q[:] = q
            each.duct.q_start[:] = q
        before_j = dissipated_j(relaxed)
        relaxed.duct.change_step(1e-3)
        relaxed.effects["nonlinear_membrane"].add_loads(relaxed.world, 1e-3)
        relaxed.effects["viscoelasticity"].after_solve(relaxed.world, 1e3)
        assert stored_in_wall_j(elastic) > 0.0
        assert dissipated_j(relaxed) > before_j
        assert stored_in_wall_j(relaxed) == pytest.approx((1.0 - sum(series.g)) * stored_in_wall_j(elastic), rel=1e-6)


def test_the_stiffening_is_kept_where_the_modes_of_the_duct_are(with_effects, tmp_path, own_cache):
    scene = with_effects(nonlinear_membrane={"n_coordinates": 2})
    of_others = set(own_cache.rglob("membrane-*"))
    simulation = Simulation(scene, build_scene_duct(scene, tmp_path))
    assert simulation.duct.reduced.cache_dir == tmp_path
    assert len(list(tmp_path.glob("membrane-*/manifest.json"))) == 1
    assert set(own_cache.rglob("membrane-*")) == of_others


def test_a_duct_of_unknown_making_cannot_stiffen(with_effects, small_duct):
    with pytest.raises(ValueError, match=r"effects.nonlinear_membrane: .* use build_scene_duct"):
        Simulation(with_effects(nonlinear_membrane={}), replace(small_duct, recipe=None))


def test_a_wall_that_stiffens_as_it_is_stretched_resists_more_and_its_books_balance(with_effects, small_duct):
    """A tool bends the duct aside and lets it back; the bent duct is stretched on one side."""
    force, flows = [], []
    for effects in ({}, {"hyperelasticity": {"exponent": 200.0}}):
        simulation, tools = Simulation(with_effects(**effects), small_duct), ToolInputs()
        tools.present[1] = False
        tools.position_m[0] = np.add(PRESSED_M, (0.0, 0.0, 4e-3))
        simulation.step(tools)
        book, largest = EnergyBook(simulation), 0.0
        for tick in range(1200):
            tools.position_m[0, 2] = PRESSED_M[2] + 4e-3 - 10e-3 * max(0.0, 1.0 - abs(tick / 600.0 - 1.0))
            book.step(tools)
            largest = max(largest, float(np.linalg.norm(simulation.tool_results.force_n[0])))
        force.append(largest)
        flows.append(book.flow)
    assert force[1] > 1.1 * force[0]
    for flow in flows:
        assert abs(flow.imbalance_j) < 0.01 * (flow.dissipated_j + flow.stored_j)


def test_a_wall_of_unknown_making_has_no_law(with_effects, small_duct):
    with pytest.raises(ValueError, match=r"effects.hyperelasticity: .* use build_scene_duct"):
        Simulation(with_effects(hyperelasticity={}), replace(small_duct, recipe=None))


def test_a_term_that_gives_way_needs_no_shorter_steps(with_effects, small_duct):
    """Its energy is below the linear wall's: a tank that may hold a share of it was never empty enough."""
    simulation = Simulation(with_effects(nonlinear_membrane={}), small_duct)
    terms, held = terms_of(simulation.duct), []
    hold = terms.hold
    terms.hold = lambda dt_s: held.append(dt_s) or hold(dt_s)
    come_down(simulation)
    lowest_j = 0.0
    tools = come_down(simulation)
    held.clear()
    for _ in range(100):
        simulation.step(tools)
        lowest_j = min(lowest_j, terms.energy_j())
    assert lowest_j < 0.0
    assert len(held) == 100
