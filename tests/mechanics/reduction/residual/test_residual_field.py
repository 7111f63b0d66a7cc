"""The residual displacement round the loads is that of the residual compliance."""

from dataclasses import replace

import numpy as np

from services.mechanics import scenarios
from services.mechanics.reduction.residual.residual_field import ResidualField
from services.mechanics.simulation.scene_duct import build_scene_duct


def test_the_field_is_the_residual_of_the_loads(cache_dir):
    duct = build_scene_duct(scenarios.insertion_scene(), cache_dir)
    nodes = np.array([200, 201, 340], np.int32)  # two neighbours, each within the rings of the other, and one apart
    forces = np.random.default_rng(1).normal(size=(3, 3))
    field = ResidualField(duct, 1e-3)
    for loads in (slice(0, 3), slice(0, 2)):  # the second time on the scratch that the first has left
        field.update(nodes[loads], forces[loads])
        found = field.nodes[: field.count]
        assert len(set(found.tolist())) == field.count > 40
        near = [int(np.flatnonzero(found == node)[0]) for node in nodes[:2]]
        exact = np.zeros((2, 3))
        duct.residual.apply(nodes[:2], forces[:2], nodes[:2], exact)
        np.testing.assert_allclose(field.displacement_m[near], exact, rtol=1e-6)


def test_a_deep_dent_reaches_further_than_a_shallow_one(cache_dir):
    """Jaws press on dozens of nodes: what each of them moves further off adds up to tenths of a millimetre."""
    duct = build_scene_duct(scenarios.insertion_scene(), cache_dir)
    node, field = np.array([200], np.int32), ResidualField(duct, 1e-3)
    reached = []
    for force_n in (1e-3, 1.0):
        force = np.array([[0.0, 0.6, 0.8]]) * force_n
        field.update(node, force)
        found = field.nodes[: field.count].copy()
        exact = np.zeros((len(found), 3))
        duct.residual.apply(node, force, found, exact)
        np.testing.assert_allclose(field.displacement_m[: field.count], exact, rtol=1e-6, atol=1e-9 * force_n)
        reached.append(set(found.tolist()))
        left = np.setdiff1d(np.arange(duct.mesh.n_vertices, dtype=np.int32), found).astype(np.int32)
        missed = np.zeros((len(left), 3))
        duct.residual.apply(node, force, left, missed)
        own = np.linalg.norm(exact[found.tolist().index(200)])
        assert np.linalg.norm(missed, axis=1).max() < (0.2 if force_n < 0.1 else 0.1) * own
    assert reached[0] < reached[1]


def test_a_thin_wall_is_where_all_loads_together_move_it(cache_dir):
    """What jaws press on moves up to a wall and a half beside, by dents that are each small beyond six edges."""
    scene = scenarios.insertion_scene()
    thickness_m = 40e-6
    duct = build_scene_duct(replace(scene, duct=replace(scene.duct, thickness_m=thickness_m)), cache_dir)
    nodes = np.concatenate([np.arange(100, 112), np.arange(260, 272)]).astype(np.int32)
    forces = np.zeros((len(nodes), 3))
    forces[:, 2] = np.where(nodes < 200, 1.0, -0.3)
    exact, field = np.zeros((len(nodes), 3)), ResidualField(duct, thickness_m)
    duct.residual.apply(nodes, forces, nodes, exact)
    forces *= 0.5e-3 / np.abs(exact).max()  # half a millimetre is what jaws do to such a wall
    exact *= 0.5e-3 / np.abs(exact).max()
    field.update(nodes, forces)
    found = field.nodes[: field.count].tolist()
    moved = field.displacement_m[[found.index(node) for node in nodes]]
    assert np.linalg.norm(moved - exact, axis=1).max() < 0.01 * thickness_m


def test_a_thin_wall_is_there_beside_what_is_pressed_too(cache_dir):
    """Seven edges from jaws it was seen 25 walls of 8 um beside where it is: what bulged there had no contact."""
    scene = scenarios.insertion_scene()
    duct = build_scene_duct(replace(scene, duct=replace(scene.duct, thickness_m=8e-6)), cache_dir)
    every = np.arange(duct.mesh.n_vertices, dtype=np.int32)
    nodes, force, exact = every[250:262], np.zeros((12, 3)), np.zeros((len(every), 3))
    force[:, 2] = 1.0
    duct.residual.apply(nodes, force, every, exact)
    field = ResidualField(duct, 8e-6)
    field.update(nodes, force)
    found = np.zeros_like(exact)
    found[field.nodes[: field.count]] = field.displacement_m[: field.count]
    assert np.linalg.norm(found - exact, axis=1).max() < 0.01 * np.linalg.norm(exact, axis=1).max()
