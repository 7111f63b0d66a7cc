"""The residual displacement round the loads is that of the residual compliance."""

import numpy as np

from services.mechanics import scenarios
from services.mechanics.reduction.residual.field import ResidualField
from services.mechanics.simulation.scene_duct import build_scene_duct


def test_the_field_is_the_residual_of_the_loads(cache_dir):
    duct = build_scene_duct(scenarios.insertion_scene(), cache_dir)
    nodes = np.array([200, 201, 340], np.int32)  # two neighbours, each within the rings of the other, and one apart
    forces = np.random.default_rng(1).normal(size=(3, 3))
    field = ResidualField(duct)
    for loads in (slice(0, 3), slice(0, 2)):  # the second time on the scratch that the first has left
        field.update(nodes[loads], forces[loads])
        found = field.nodes[: field.count]
        assert len(set(found.tolist())) == field.count > 40
        near = [int(np.flatnonzero(found == node)[0]) for node in nodes[:2]]
        exact = np.zeros((2, 3))
        duct.residual.apply(nodes[:2], forces[:2], nodes[:2], exact)
        np.testing.assert_allclose(field.displacement_m[near], exact, rtol=1e-6)
