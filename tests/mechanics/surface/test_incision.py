"""A partial cut: one opening more, exactly as long and as deep as said, with lips that hang on the rest of the wall."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.scene.cystic_duct import CysticDuctScene
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.scene.incision import IncisionScene
from trocar.services.mechanics.simulation.scene_duct import check_scene_duct, opened_mesh, scene_mesh
from trocar.services.mechanics.surface.incision import INCISION, Incision, incise
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    smallest_angles_rad,
    triangle_area_vectors,
    unique_edges,
    vertex_components,
)
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.meshes.branching import branching_mesh
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import build_scene

RADIUS_M, LENGTH_M, AT_M = 4e-3, 40e-3, 9e-3
FRONT = (0.0, 0.0, 1.0)


def tube(n_around: int = 32, n_along: int = 40) -> TriangleMesh:
    return parametric_duct(DuctGeometry(RADIUS_M, LENGTH_M, n_around, n_along))


def euler(mesh: TriangleMesh) -> int:
    return mesh.n_vertices - len(unique_edges(mesh)[0]) + mesh.n_triangles


@pytest.mark.parametrize(("n_around", "n_along"), [(20, 26), (33, 41), (72, 70)])
@pytest.mark.parametrize(("depth", "length_m"), [(0.15, 0.8e-3), (0.5, 2e-3), (0.8, 3e-3)])
def test_a_cut_is_one_rim_more_as_long_and_as_deep_as_said(
    n_around: int, n_along: int, depth: float, length_m: float
) -> None:
    whole = tube(n_around, n_along)
    cut = incise(whole, Incision(AT_M, depth, length_m, FRONT))
    assert euler(whole) == 0
    assert euler(cut) == -1
    assert len(boundary_loops(cut)) == 3
    assert vertex_components(cut).max() == 0
    rim = cut.vertices_m[cut.vertex_sets[INCISION]]
    assert np.ptp(rim[:, 0]) == pytest.approx(length_m, rel=0.01)  # at the vertex that is nearest to the front
    assert rim[:, 0].mean() == pytest.approx(LENGTH_M - AT_M, abs=1e-9)
    assert np.abs(np.arctan2(rim[:, 1], rim[:, 2])).max() == pytest.approx(np.pi * depth, rel=1e-9)
    assert np.degrees(smallest_angles_rad(cut).min()) > 8.0
    outward = triangle_area_vectors(cut) * (cut.vertices_m[cut.triangles].mean(axis=1) * [0.0, 1.0, 1.0])
    assert outward.sum(axis=1).min() > 0.0


def test_the_rim_is_told_in_order_and_the_other_ends_stay_as_they_are() -> None:
    whole = tube()
    cut = incise(whole, Incision(AT_M, 0.4, 1.5e-3, FRONT))
    rim = cut.vertex_sets[INCISION]
    loop = next(loop for loop in boundary_loops(cut) if np.isin(loop, rim).all())
    neighbours = {frozenset(pair) for pair in zip(loop, np.roll(loop, -1), strict=True)}
    assert {frozenset(pair) for pair in zip(rim, np.roll(rim, -1), strict=True)} == neighbours
    for name in ("mouth", "clamped"):
        assert np.array_equal(cut.vertex_sets[name], whole.vertex_sets[name])
        assert np.array_equal(cut.vertices_m[cut.vertex_sets[name]], whole.vertices_m[whole.vertex_sets[name]])


def test_the_lips_are_as_long_as_the_cut_is_deep() -> None:
    cut = incise(tube(72, 70), Incision(AT_M, 0.5, 0.5e-3, FRONT))
    rim = cut.vertices_m[cut.vertex_sets[INCISION]]
    around_m = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).sum()
    assert around_m == pytest.approx(2.0 * np.pi * RADIUS_M, rel=0.01)


def test_the_front_turns_the_cut_and_need_not_be_square_to_the_duct() -> None:
    cut = incise(tube(), Incision(AT_M, 0.3, 1e-3, (0.4, 1.0, 0.0)))
    middle = cut.vertices_m[cut.vertex_sets[INCISION]].mean(axis=0)
    assert middle[1] > 0.7 * RADIUS_M
    assert middle[2] == pytest.approx(0.0, abs=0.05 * RADIUS_M)


def test_a_cystic_duct_is_cut_where_it_has_no_folds_and_keeps_its_other_openings() -> None:
    duct = DuctScene(cystic=CysticDuctScene(folds=0), thickness_m=1e-3, incision=IncisionScene(at_m=7e-3, depth=0.4))
    whole = branching_mesh(duct_tubes(duct), 1e-3)
    cut = opened_mesh(duct, whole)
    assert euler(cut) == euler(whole) - 1
    assert set(cut.vertex_sets) == {*whole.vertex_sets, INCISION}


def section(mesh: TriangleMesh) -> ShellModel:
    return ShellModel(mesh, ShellSection(1e-3, 300e3, 0.45, 1060.0), (clamp(mesh),), ElementChoice(bending="dkmt"))


def lifted_m(mesh: TriangleMesh) -> tuple[float, float]:
    """How far a newton on the mouth's rim moves it, across the front of the duct, and along the duct."""
    model, rim = section(mesh), mesh.vertex_sets["mouth"]
    moved = []
    for direction in ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0)):
        load = np.zeros_like(mesh.vertices_m)
        load[rim] = np.array(direction) / len(rim)
        moved.append(float((model.solve_static(load).displacement_m[rim] @ direction).mean()))
    return moved[0], moved[1]


def test_the_deeper_the_cut_the_softer_the_duct_and_a_cut_of_next_to_nothing_changes_nothing() -> None:
    whole = np.array(lifted_m(tube()))
    depths = (0.02, 0.2, 0.4, 0.6, 0.8)
    cut = np.array([lifted_m(incise(tube(), Incision(AT_M, depth, 1e-3 * depth, FRONT))) for depth in depths])
    assert cut[0] == pytest.approx(whole, rel=0.005)
    assert (np.diff(cut, axis=0) > 0.0).all()
    assert (cut[-1] > 1.5 * whole).all()


def test_a_scene_without_a_cut_has_the_mesh_that_it_had() -> None:
    whole = scene_mesh(DuctScene())
    assert opened_mesh(DuctScene(), whole) is whole


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"at_m": 0.0}, r"duct\.incision\.at_m: must be positive, is 0\.0"),
        ({"depth": -0.1}, r"duct\.incision\.depth: must be positive, is -0\.1"),
        ({"depth": 0.9}, r"duct\.incision\.depth: at most 0\.8 of the circumference can be cut, is 0\.9"),
        ({"length_m": 0.0}, r"duct\.incision\.length_m: must be positive, is 0\.0"),
        ({"front": [0.0, 0.0, 0.0]}, r"duct\.incision\.front: must not be zero"),
    ],
)
def test_a_number_that_makes_no_cut_is_refused_by_its_key(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(ConfigError, match=f"^scene.yaml: {sentence}$"):
        build_scene({"duct": {"incision": values}}, "scene.yaml")


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"at_m": 0.1}, r"duct\.incision\.at_m: the duct has no wall 100 mm behind its mouth, it ends before"),
        (
            {"at_m": 1e-3},
            r"duct\.incision\.at_m: the cut comes too near to an end of the duct, .*",
        ),
        ({"at_m": 38e-3}, r"duct\.incision\.at_m: the .*"),
        ({"front": (1.0, 0.0, 0.1)}, r"duct\.incision\.front: \[1.0, 0.0, 0.1\] is along the duct there, not across"),
    ],
)
def test_a_cut_that_this_duct_has_no_place_for_is_refused_by_its_key(values: dict[str, object], sentence: str) -> None:
    scene = SceneModel(duct=DuctScene(incision=IncisionScene(**values)))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=f"^{sentence}$"):
        check_scene_duct(scene)
