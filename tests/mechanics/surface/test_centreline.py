"""Ways through a branching tube, read off its surface, against the axes that it was made of."""

import numpy as np
import pytest

from trocar.services.mechanics.scene import DuctScene
from trocar.services.mechanics.scene.duct_branch import DuctBranch
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.surface.centreline import centrelines
from trocar.services.mechanics.surface.mesh import TriangleMesh, smallest_angles_rad
from trocar.services.meshes.branching import branching_mesh
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.tube_paths import TubePaths

POCKET = {"at_m": 15e-3, "angle_rad": 1.3, "azimuth_rad": 0.5 * np.pi, "radius_m": 2.5e-3, "length_m": 14e-3}
BRANCHES = (
    DuctBranch(name="left", angle_rad=0.6, radius_m=3.5e-3, length_m=25e-3, end="free"),
    DuctBranch(name="right", angle_rad=0.6, azimuth_rad=np.pi, radius_m=3.5e-3, length_m=25e-3),
    DuctBranch(name="pocket", **POCKET, end="blind"),
)
DUCT = DuctScene(radius_m=4.5e-3, length_m=40e-3, branches=BRANCHES)


@pytest.fixture(scope="module")
def mesh():
    return branching_mesh(duct_tubes(DUCT), 1.6e-3)


def test_a_branching_mesh_has_its_ends_where_they_belong_and_no_slivers(mesh):
    assert np.degrees(smallest_angles_rad(mesh).min()) > 25.0
    assert set(mesh.vertex_sets) == {"mouth", "left", "right", "pocket", "clamped"}
    np.testing.assert_array_equal(np.sort(mesh.vertex_sets["clamped"]), np.sort(mesh.vertex_sets["right"]))
    for tube in duct_tubes(DUCT)[1:3]:
        end_m = tube.place(tube.length_m)[0]
        assert (
            np.linalg.norm(mesh.vertices_m[mesh.vertex_sets[tube.name]].mean(axis=0) - end_m) < 0.8e-3
        )  # half an edge is what a rim may lose


def test_ways_lie_on_the_axes_and_part_where_the_branches_do(mesh):
    """Within a fifth of the radius of the axes but round the joins, where they run into the crotch; lengths to 6 %."""
    paths = TubePaths(centrelines(mesh))
    assert set(paths.path_m) == {"left", "right", "pocket"}
    for name, length_m in (("left", 65e-3), ("right", 65e-3), ("pocket", 29e-3)):
        assert paths.arc_m[name][-1] == pytest.approx(length_m, rel=0.06, abs=2.5e-3)
    for tube in duct_tubes(DUCT):
        for share in {"trunk": (0.1, 0.25, 0.9), "pocket": ()}.get(tube.name, (0.6, 0.9)):
            at = tube.place(share * tube.length_m)[0]
            path = paths.path_m["left" if tube.name == "trunk" else tube.name]
            dense = path[:-1, None] + np.linspace(0.0, 1.0, 20)[:, None] * np.diff(path, axis=0)[:, None]
            assert np.linalg.norm(dense - at, axis=2).min() < 0.25 * tube.radius_m
    assert 13e-3 < paths.shared_m("left", "pocket") < 21e-3
    assert 38e-3 < paths.shared_m("left", "right") < 51e-3


def test_progress_on_another_branch_is_that_of_where_they_part(mesh):
    paths = TubePaths(centrelines(mesh))
    tubes = {tube.name: tube for tube in duct_tubes(DUCT)}
    in_left, in_trunk = tubes["left"].place(20e-3)[0], tubes["trunk"].place(8e-3)[0]
    assert paths.progress_m(in_left, "left") == pytest.approx(60e-3, abs=DUCT.radius_m)
    assert paths.progress_m(in_left, "right") == paths.shared_m("left", "right")
    assert paths.beyond(in_left) == ["left"]
    assert set(paths.beyond(in_trunk)) == {"left", "right", "pocket"}
    for name in paths.path_m:
        assert paths.progress_m(in_trunk, name) == pytest.approx(8e-3, abs=1e-3)


def test_a_tube_without_named_ends_has_no_ways(mesh):
    sets = {name: mesh.vertex_sets[name] for name in ("mouth", "clamped")}
    assert centrelines(TriangleMesh(mesh.vertices_m, mesh.triangles, sets)) == {}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"parent": "lef"}, "duct.branches.3.parent: 'lef' is none of the tubes above it"),
        ({"name": "left"}, "duct.branches.3.name: 'left' is taken"),
        ({"at_m": 0.5}, "duct.branches.3.at_m: must lie between 0 and 0.04"),
        ({"radius_m": 6e-3}, "duct.branches.3.radius_m: is wider than 'trunk'"),
        ({"taper": 1.0}, "duct.branches.3.taper: must be at least 0 and below 1"),
    ],
)
def test_branches_that_cannot_be_are_refused_in_one_sentence(change, sentence):
    more = DuctBranch(**{"name": "more", "radius_m": 3e-3, **change})
    with pytest.raises(ValueError, match=sentence.replace(".", r"\.")):
        duct_tubes(DuctScene(radius_m=4.5e-3, length_m=40e-3, branches=(*BRANCHES, more)))


def test_tubes_that_touch_beside_their_joins_are_refused():
    beside = DuctBranch(name="more", angle_rad=0.62, radius_m=3.5e-3, length_m=25e-3, end="free")
    with pytest.raises(MeshError, match="open ends"):
        branching_mesh(duct_tubes(DuctScene(radius_m=4.5e-3, length_m=40e-3, branches=(*BRANCHES, beside))), 2.4e-3)
