"""The residual displacement round the loads is the same from the whole residual and from the copy of haptics."""

import numpy as np

from services.mechanics import scenarios
from services.mechanics.reduction.residual.field import ResidualField
from services.mechanics.simulation.scene_duct import build_scene_duct


def test_both_fields_are_the_residual_of_the_loads(cache_dir):
    duct = build_scene_duct(scenarios.insertion_scene(), cache_dir)
    nodes = np.array([200, 201, 340], np.int32)
    forces = np.random.default_rng(1).normal(size=(3, 3))
    whole, near = ResidualField(duct), ResidualField(duct, copies=True)
    for _ in range(2):  # the second time on the scratch that the first has left
        whole.update(nodes, forces)
        near.update(nodes, forces)
        n = whole.count
        assert n == near.count > 60
        np.testing.assert_array_equal(whole.nodes[:n], near.nodes[:n])
        np.testing.assert_allclose(near.displacement_m[:n], whole.displacement_m[:n], rtol=1e-12, atol=1e-18)
    near.update(nodes[:2], forces[:2])  # neighbours: each is within the rings of the other
    at_loads = np.zeros((2, 3))
    duct.residual.apply(nodes[:2], forces[:2], nodes[:2], at_loads)
    places = [int(np.flatnonzero(near.nodes[: near.count] == node)[0]) for node in nodes[:2]]
    np.testing.assert_allclose(near.displacement_m[places], at_loads, rtol=1e-9)
