"""Jaws that hold a duct in a hand that trembles: contacts open and slip by turns, and every solve comes to an end."""

from dataclasses import replace

import numpy as np

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import hands_of


def test_no_solve_ends_because_its_sweeps_run_out(cache_dir):
    """With ten times as many allowed, every bit is the same. A Newton step that opened one contact by far was not kept,
    and sweeps crept: 25 of 1100 ticks took 30 or more, one 100, with forces 50 mN from where they go."""
    scene = load_scene("pinch", ["duct.n_around=24", "duct.n_along=30", "duct.n_modes=40"])
    duct = load_duct(scene, cache_dir, lambda *_: None)
    full = scene.quality[0]
    more = replace(scene, quality=(replace(full, iterations=10 * full.iterations), *scene.quality[1:]))
    ends = []
    for allowed in (scene, more):
        simulation, tools, forces_n = Simulation(allowed, duct), ToolInputs(), []
        hands, random, away_m = hands_of(simulation.scene, duct.mesh), np.random.default_rng(1), np.zeros((2, 3))
        for tick in range(1800):
            hands.write_inputs(min(1e-3 * tick, 2.0), tools)
            away_m = 0.995 * away_m + 2e-6 * random.standard_normal((2, 3))
            tools.position_m += away_m
            simulation.step(tools)
            forces_n.append(simulation.tool_results.force_n.copy())
        assert simulation.contacts.n_contacts > 10
        ends.append(np.array(forces_n))
    np.testing.assert_array_equal(*ends)


def test_a_point_on_an_edge_is_one_contact_whichever_triangle_it_is_found_on(cache_dir):
    """A grip on an edge got a second row for the other triangle by price: 143 times, each with a solve of its own."""
    scene = load_scene("pinch")
    duct = load_duct(scene, cache_dir, lambda *_: None)
    simulation, tools = Simulation(scene, duct), ToolInputs()
    hands = hands_of(simulation.scene, duct.mesh)
    for tick in range(1200):
        hands.write_inputs(1e-3 * (tick + 1), tools)
        simulation.step(tools)
    assert simulation.contacts.n_contacts > 10
    assert simulation.solver.pricing.new_rows < 10
    assert simulation.dropped_contacts == (0, 0, 0)
