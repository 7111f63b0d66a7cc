"""What lies between jaws: counted as by brute force, and nothing is squeezed where there is nothing."""

from dataclasses import replace

import numpy as np
import pytest

from tests.mechanics.simulation.test_pinch_to_closure import EFFECTS, TOOL, Pinch
from trocar.services.mechanics.bodies.forceps.kinematics import N_CELLS
from trocar.services.mechanics.collision.pairs import JAW_A, JAW_B
from trocar.studies.judge.closest import count_layers
from trocar.studies.judge.overlaps import pose_tools

LOOKED_AT = range(560, 790, 10)


def by_brute_force(simulation):
    """Layers on the line between both jaws' axes in the middle of each cell."""
    poses = np.zeros_like(simulation.tools.segments)
    pose_tools(simulation.tools, poses)
    wall_m, triangles = simulation.duct.surface_m(), simulation.duct.reduced.mesh.triangles.astype(np.int32)
    lines = [
        [(1.0 - s) * poses[TOOL, jaw, 0] + s * poses[TOOL, jaw, 1] for jaw in (JAW_A, JAW_B)]
        for s in (np.arange(N_CELLS) + 0.5) / N_CELLS
    ]
    return np.array([count_layers(*line, wall_m, triangles) for line in lines], float)


@pytest.mark.parametrize("squeeze", ["shut at the middle", "shut near the mouth", "shut by the tips"])
def test_layers_are_counted_as_by_brute_force_and_nothing_is_squeezed_where_there_is_none(
    small_scene, small_duct, squeeze
):
    """A cell beside one with layers has as many."""
    seen = right = 0
    for tick, (simulation, _) in enumerate(Pinch(replace(small_scene, effects=EFFECTS), small_duct, squeeze).states()):
        if tick not in LOOKED_AT or not simulation.squeeze.occupied[TOOL].any():
            continue
        counted, expected = simulation.squeeze.arrays.counted[TOOL], by_brute_force(simulation)
        has_some = expected > 0.0
        beside = ~has_some & (np.append(has_some[1:], False) | np.append(False, has_some[:-1]))
        assert counted[beside].all()
        assert not counted[~has_some & ~beside].any()
        seen, right = seen + has_some.sum(), right + (counted == expected)[has_some].sum()
        squeezed = simulation.squeeze.arrays.wall.layers[TOOL] > 0.0
        assert not simulation.tools.indentation_m[TOOL][~squeezed].any()
    assert seen > 50
    assert right == seen
