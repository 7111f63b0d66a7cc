"""The bending triangle that a scene's wall takes by itself: one with shear unless the wall is thin."""

import numpy as np
import pytest

from trocar.services.mechanics.fem import ShellSection
from trocar.services.mechanics.fem.thinness import THIN, bending_of_wall, mean_curvature_1_m
from trocar.services.mechanics.scene.duct_recipe import duct_recipe
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.runtime.config import config
from trocar.services.scenes import load_scene, load_surface

SCENES = sorted(path.stem for path in (config.config_directory() / "scenes").glob("*.yaml") if path.stem != "anatomy")


@pytest.mark.parametrize("name", SCENES)
def test_every_shipped_scene_has_a_wall_with_shear(name, own_cache):
    """But the paper's, which is to be compared with print."""
    scene = load_scene(name, ["duct.n_around=12", "duct.n_along=12"])
    mesh = load_surface(scene, own_cache)
    wanted = "tocher" if name == "paper" else "reissner"
    assert duct_recipe(scene.duct, mesh).elements.bending == wanted


@pytest.mark.parametrize("curvature_1_m", [0.0, 26.0])
def test_the_curvature_of_a_tube_is_that_of_its_circle(curvature_1_m):
    mesh = parametric_duct(DuctGeometry(7e-3, 110e-3, 32, 60, curvature_1_m=curvature_1_m))
    assert mean_curvature_1_m(mesh) == pytest.approx(1.0 / 7e-3, rel=0.01)


def test_roughness_does_not_count():
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 32, 40))
    rough = mesh.vertices_m * (1.0 + 0.02 * np.random.default_rng(1).standard_normal((mesh.n_vertices, 1)) * [0, 1, 1])
    assert mean_curvature_1_m(TriangleMesh(rough, mesh.triangles, mesh.vertex_sets)) == pytest.approx(250.0, rel=0.05)


def test_a_plate_has_none_and_a_wall_is_thin_below_the_bound():
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    triangles = np.array([[0, 3, 1], [1, 3, 4], [1, 4, 2], [2, 4, 5]], np.int32)
    assert mean_curvature_1_m(TriangleMesh(vertices, triangles, {})) == 0.0
    tube = parametric_duct(DuctGeometry(4e-3, 40e-3, 48, 40))
    for factor, wanted in ((0.97, "dkt"), (1.03, "reissner")):
        assert bending_of_wall(tube, ShellSection(factor * THIN * 4e-3, 1e5, 0.45, 1060.0)) == wanted
