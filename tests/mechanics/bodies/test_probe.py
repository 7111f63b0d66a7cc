"""A probe touches with one sphere: a point proxy on the surface, the full finite elements' force, books that close."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csc_array

from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, SHAFT
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.scene import ProbeScene
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.accuracy.pinches import full_model
from trocar.studies.energy_book import EnergyBook
from trocar.studies.stability.hands import least_jerk

PROBE = ProbeScene(port_position_m=(20e-3, 0.0, 0.15))
REACH_M = 4e-3 + 0.5e-3 + PROBE.tip_radius_m  # of the small duct: from its axis to the middle of a sphere that touches


def simulation_of(small_scene, small_duct, **changes):
    tools = (PROBE, replace(PROBE, port_position_m=(60e-3, 10e-3, 0.15)))
    return Simulation(replace(small_scene, forceps=tools, **changes), small_duct)


def push(simulation, path_m, book=None):
    """Lead the first probe along (n, 3), a row a tick; the other one is away."""
    tools = ToolInputs()
    tools.present[1] = False
    for at in path_m:
        tools.position_m[0] = at
        simulation.step(tools) if book is None else book.step(tools)
    return simulation.tool_results


def down(x_m, depth_m, angle_rad=0.0, hold=400):
    """From 2 mm outside the wall at x, seen from the side, into it, and stay there."""
    outward = np.array([0.0, np.sin(angle_rad), np.cos(angle_rad)])
    start = np.array([x_m, 0.0, 0.0]) + (REACH_M + 2e-3) * outward
    way = least_jerk(2e-3 + depth_m, -outward, 0.05)
    return np.concatenate([start + way, np.repeat(start + way[-1:], hold, axis=0)])


@pytest.mark.parametrize(
    ("x_m", "angle_rad", "depth_m"), [(20e-3, 0.0, 0.5e-3), (31e-3, 0.7, 1.5e-3), (9e-3, -0.9, 1e-3)]
)
def test_its_force_is_that_of_the_full_finite_elements(small_scene, small_duct, x_m, angle_rad, depth_m):
    """What the wall's displacement under the probe takes there, within 1 %; and the hand feels all of it."""
    simulation = simulation_of(small_scene, small_duct)
    felt = push(simulation, down(x_m, depth_m, angle_rad)).force_n[0]
    loads_n = np.zeros((small_duct.mesh.n_vertices, 3))
    duct, n = simulation.duct, simulation.duct.n_loads
    np.add.at(loads_n, duct.load_nodes[:n], duct.load_force_n[:n])
    np.testing.assert_allclose(felt, -loads_n.sum(axis=0), atol=1e-3 * np.linalg.norm(felt))
    model = full_model(small_scene.duct)
    full_m = nodal_translations(model, factorise(csc_array(model.K_free)).solve(free_load(model, loads_n)))
    moved_m = simulation.duct.surface_m() - small_duct.mesh.vertices_m
    assert np.linalg.norm(moved_m, axis=1).max() > 0.3 * depth_m
    assert np.sum(loads_n * full_m) == pytest.approx(np.sum(loads_n * moved_m), rel=0.01)


def test_the_proxy_stays_on_the_surface_and_the_coupling_is_the_force(small_scene, small_duct):
    """As of a God object: the hand is inside, the proxy is not, and the force is the spring between both."""
    simulation = simulation_of(small_scene, small_duct)
    path = down(20e-3, 2e-3)
    results = push(simulation, path)
    proxy = results.proxy_position_m[0]
    spring_n = PROBE.coupling_stiffness_n_m * (proxy - path[-1])
    np.testing.assert_allclose(results.force_n[0], spring_n, rtol=1e-3, atol=1e-6)
    corners = simulation.duct.surface_m()[small_duct.mesh.triangles]
    weights = np.random.default_rng(1).dirichlet(np.ones(3), 400)
    nearest_m = np.linalg.norm(np.einsum("wk,tkx->twx", weights, corners) - proxy, axis=2).min()
    assert nearest_m == pytest.approx(PROBE.tip_radius_m + 0.5e-3, abs=20e-6)


def test_only_its_sphere_touches(small_scene, small_duct):
    """The shaft passes through the wall that it crosses; every contact is of the segment that stands for the tip."""
    inside = np.array([[20e-3, 0.0, 0.0]] * 50)  # through the roof, in the middle of the lumen
    simulation = simulation_of(
        small_scene, small_duct, catheter=replace(small_scene.catheter, tip_position_m=(48e-3, 0.0, 0.0))
    )
    assert not push(simulation, inside).force_n.any()
    simulation = simulation_of(small_scene, small_duct)
    push(simulation, down(20e-3, 1e-3))
    pairs = simulation.world.pairs
    pairs.clear()
    simulation.search.begin(simulation.system)
    simulation.search.write_pairs(simulation.system.address, pairs)
    of_probe = pairs.tool[: pairs.count] == 0
    assert of_probe.any()
    assert set(pairs.tool_segment[: pairs.count][of_probe]) == {SHAFT}


def test_it_pushes_the_catheter_and_holds_nothing(small_scene, small_duct):
    """From above onto the catheter before the mouth; a hold that somebody asks for is refused."""
    simulation = simulation_of(small_scene, small_duct)
    x_m, reach_m = 52e-3, simulation.catheter.radius_m + PROBE.tip_radius_m
    before_m = simulation.catheter.state.position_m.copy()
    start = np.array([x_m, 0.0, reach_m + 1e-3])
    way = start + least_jerk(4e-3, np.array([0.0, 0.0, -1.0]), 0.05)
    results = push(simulation, np.concatenate([way, np.repeat(way[-1:], 100, axis=0)]))
    assert results.force_n[0, 2] > 1e-3
    assert simulation.catheter.state.position_m[:, 2].min() < before_m[:, 2].min() - 2e-3
    assert not results.grasp_torque_nm.any()
    assert not simulation.holds.active
    tools = ToolInputs()
    tools.present[1] = False
    tools.position_m[0] = way[-1]
    tools.holds = [GraspHold(2, 0, CATHETER_SEGMENT, 5, np.array([0.5, 0.5, 0.0]), 1.0, 0.0)]
    simulation.step(tools)
    assert not simulation.holds.active
    assert simulation.refused_inputs == 1


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_its_books_close(small_scene, small_duct, seed):
    """Pressed and dragged over wall and catheter with friction, then taken away: nothing comes out that was not in."""
    random = np.random.default_rng(seed)
    simulation = simulation_of(small_scene, small_duct, effects={"friction": FrictionSettings()})
    path = down(random.uniform(12e-3, 34e-3), random.uniform(0.5e-3, 2e-3), random.uniform(-1.0, 1.0), hold=50)
    for _ in range(4):
        direction = random.normal(size=3) * (1.0, 0.5, 0.3)
        drag = least_jerk(random.uniform(2e-3, 8e-3), direction / np.linalg.norm(direction), random.uniform(0.05, 0.4))
        path = np.concatenate([path, path[-1] + drag])
    path = np.concatenate([path, path[-1] + least_jerk(20e-3, np.array([0.0, 0.0, 1.0]), 0.2)])
    push(simulation, path[:1])
    book = EnergyBook(simulation)
    push(simulation, path[1:], book=book)
    assert book.flow.input_j > 1e-6
    assert abs(book.flow.imbalance_j) < 0.01 * book.flow.input_j
    assert simulation.healed_states == 0
