"""A duct whose cross-sections turn is drawn where physics has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trocar.protocol import bodies
from trocar.protocol.arrays import pack
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.bodies.wall_motion import wall_motion
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.drawn_surface import DrawnSurface

SMALL = Path(__file__).parents[1] / "scenes" / "small.yaml"


@pytest.fixture(scope="module")
def turning() -> ReducedDuct:
    scene = load_scene(SMALL, ["effects.large_rotations={}"])
    return load_duct(scene, cache_directory(), lambda stage, fraction: None)


def test_turned_sections_are_drawn_turned(turning: ReducedDuct) -> None:
    basis = turning.basis
    q = np.zeros(basis.n_modes)
    q[:3] = 1.0, -0.7, 0.3
    q *= 10e-3 / np.abs(basis.displacements(q)).max()  # far: the straight modes are off by more than a millimetre
    body = bodies.Duct(
        basis_hash=basis.content_hash, q=pack(q), q_rate=pack(0.0 * q), load_node=pack([], "<i4"),
        load_force_n=pack(np.zeros((0, 3))),
    )  # fmt: skip
    surface = DrawnSurface(turning)
    assert surface.update(body)
    motion, every = wall_motion(turning, basis.n_nodes), np.arange(basis.n_nodes, dtype=np.int32)
    motion.update(q)
    np.testing.assert_allclose(surface.points_m, motion.position_function(every)(q), atol=1e-8)
    straight = turning.mesh.vertices_m + basis.displacements(q)
    assert np.abs(surface.points_m - straight).max() > 1e-3
