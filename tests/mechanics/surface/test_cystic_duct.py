"""A cystic duct by its anatomy: what is drawn lies in its ranges, and the tube is what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from trocar.services.mechanics.scene.cystic_duct import (
    ALPHA_LENGTH,
    COURSES,
    RANGES,
    CysticDuctScene,
    drawn_cystic_duct,
)
from trocar.services.mechanics.scene.cystic_tubes import cystic_tubes
from trocar.services.mechanics.scene.duct_recipe import wall_section
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.scene.scene_model import DuctScene
from trocar.services.mechanics.surface.branched_tubes import union_distance_m
from trocar.services.mechanics.surface.curved_tube import CurvedTube
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.meshes.branching import branching_mesh
from trocar.services.meshes.openings import find_openings

WALL_M = 0.8e-3


def trunk(cystic: CysticDuctScene) -> CurvedTube:
    made = cystic_tubes(cystic, WALL_M)[0]
    assert isinstance(made, CurvedTube)
    return made


def test_what_is_drawn_lies_within_its_ranges_and_covers_them() -> None:
    drawn = [drawn_cystic_duct(CysticDuctScene(seed=seed)) for seed in range(200)]
    for name, quantity in RANGES.items():
        values = np.array([getattr(d, name) for d in drawn if name != "length_m" or d.course != "alpha"])
        low, high = quantity.low, quantity.high
        assert low - 1e-12 <= values.min() <= low + 0.15 * (high - low)
        assert high + 1e-12 >= values.max() >= high - 0.15 * (high - low)
    for course, share in COURSES.items():
        assert np.mean([d.course == course for d in drawn]) == pytest.approx(share, abs=0.08)
    assert all(ALPHA_LENGTH.low <= d.length_m <= ALPHA_LENGTH.high for d in drawn if d.course == "alpha")


def test_a_seed_draws_the_same_again_and_what_is_said_changes_nothing_else() -> None:
    drawn = drawn_cystic_duct(CysticDuctScene(seed=5))
    assert drawn == drawn_cystic_duct(CysticDuctScene(seed=5)) != drawn_cystic_duct(CysticDuctScene(seed=6))
    said = drawn_cystic_duct(CysticDuctScene(seed=5, width_m=4.4e-3, take_off_rad=1.0))
    assert said == replace(drawn, width_m=4.4e-3, take_off_rad=1.0)


@pytest.mark.parametrize("course", ["straight", "s", "alpha"])
def test_the_duct_has_its_length_and_leaves_the_common_duct_at_its_angle(course: str) -> None:
    duct = CysticDuctScene(course=course, take_off_rad=0.6, folds=0)
    cystic, common = cystic_tubes(duct, WALL_M)
    whole = drawn_cystic_duct(duct)
    assert cystic.length_m == pytest.approx(whole.length_m, rel=2e-3)
    assert cystic.place(cystic.length_m)[0] == pytest.approx(np.zeros(3), abs=1e-9)
    along = -cystic.place(cystic.length_m)[1][0]
    to_liver = -common.place(0.0)[1][0]
    assert np.arccos(along @ to_liver) == pytest.approx(0.6, abs=0.02)


def test_an_s_swings_both_ways_and_an_alpha_turns_once_round() -> None:
    for course, turn in (("s", 0.0), ("alpha", 2.0 * np.pi)):
        steps = np.diff(trunk(CysticDuctScene(course=course, folds=0)).points_m, axis=0)
        heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        assert abs(heading[-1] - heading[0]) == pytest.approx(turn, abs=0.05)
        if course == "s":
            assert heading.max() - heading.min() == pytest.approx(2.0 * RANGES["turn_rad"].value, abs=0.05)


def test_the_limbs_of_an_alpha_pass_each_other() -> None:
    loop = trunk(CysticDuctScene(course="alpha", folds=0))
    points = loop.points_m[::4]
    apart = np.abs(np.subtract.outer(np.arange(len(points)), np.arange(len(points)))) * 4 > 0.3 * len(loop.points_m)
    nearest_m = np.linalg.norm(points[:, None] - points[None], axis=2)[apart].min()
    assert nearest_m > 2.0 * loop.radii_m.max() + 0.5e-3


def test_the_lumen_has_its_widths() -> None:
    duct = trunk(CysticDuctScene(width_m=3e-3, end_width_m=4e-3, folds=0))
    for at_m, width_m in ((0.0, 3e-3), (duct.length_m, 4e-3)):
        middle, (_, side, _) = duct.place(at_m)
        wall = middle + 0.5 * (width_m + WALL_M) * side
        assert duct.distance_m(wall[None])[0] == pytest.approx(0.0, abs=5e-5)


def inward_m(duct: CurvedTube, at_m: np.ndarray, around_rad: np.ndarray) -> np.ndarray:
    """How far the folds reach inwards (places, angles) on the straight duct's smooth wall."""
    _, side, across = duct.place(0.0)[1]
    out = np.cos(around_rad)[:, None] * side + np.sin(around_rad)[:, None] * across
    wall = np.concatenate([duct.place(at)[0] + duct.radius_at(at) * out for at in at_m])
    folded = duct.folded_m(wall)
    moved_m = np.linalg.norm(folded - wall, axis=1)
    assert duct.inward_m(folded) == pytest.approx(moved_m, abs=1e-9)
    return moved_m.reshape(len(at_m), len(around_rad))


AROUND_RAD = np.linspace(-np.pi, np.pi, 72, endpoint=False)


def crests(height_m: np.ndarray) -> list[tuple[int, int]]:
    """Where a map (places, angles) is highest of all within some cells."""
    around = np.concatenate([height_m[:, -9:], height_m, height_m[:, :9]], axis=1)
    highest = maximum_filter(around, size=(25, 19))[:, 9:-9]
    return [(int(i), int(j)) for i, j in np.argwhere((height_m == highest) & (height_m > 0.5 * height_m.max()))]


@pytest.mark.parametrize("side_rad", [0.0, 2.0])
def test_folds_are_crescents_that_wind_round_the_half_towards_the_gallbladder(side_rad: float) -> None:
    folded = trunk(CysticDuctScene(folds=6, fold_height=0.5, fold_side_rad=side_rad))
    at_m = np.linspace(0.0, folded.length_m, 601)
    height_m = inward_m(folded, at_m, AROUND_RAD)
    assert height_m.max() == pytest.approx(0.5 * 0.5 * 3.5e-3, rel=0.01)
    assert height_m[at_m > 0.5 * folded.length_m + 6e-3].max() < 1e-6
    found = crests(height_m)
    assert len(found) == 6
    places_m, angles = at_m[[i for i, _ in found]], AROUND_RAD[[j for _, j in found]]
    assert np.diff(places_m) == pytest.approx(2.5e-3, abs=0.1e-3)
    assert np.cos(np.diff(angles)) == pytest.approx(np.cos(4.0 / 3.0 * np.pi), abs=0.1)
    assert np.cos(angles[0] - side_rad) == pytest.approx(1.0, abs=0.01)


def test_a_crescent_leaves_the_other_side_of_the_lumen_open() -> None:
    folded = trunk(CysticDuctScene(folds=6, fold_height=0.7))
    at_m = np.linspace(0.0, folded.length_m, 601)
    height_m = inward_m(folded, at_m, AROUND_RAD)
    found = crests(height_m)
    assert len(found) == 6
    for i, j in found:
        assert height_m[i, (j + 36) % 72] < 0.1 * height_m[i, j]


def test_a_fold_is_so_high_as_the_lumen_is_wide_where_it_is() -> None:
    tapered = trunk(CysticDuctScene(folds=6, fold_height=0.5, width_m=4e-3, end_width_m=2.4e-3))
    at_m = np.linspace(0.0, tapered.length_m, 601)
    height_m = inward_m(tapered, at_m, AROUND_RAD)
    for i, j in crests(height_m):
        lumen_m = tapered.radius_at(at_m[i]) - 0.5 * WALL_M
        assert height_m[i, j] == pytest.approx(0.5 * lumen_m, rel=0.03)


def test_no_more_folds_are_drawn_than_have_room() -> None:
    for seed in range(100):
        drawn = drawn_cystic_duct(CysticDuctScene(seed=seed))
        assert drawn.folds * 2e-3 <= 0.5 * drawn.length_m
        assert drawn_cystic_duct(CysticDuctScene(seed=seed, length_m=20e-3)).folds <= 5


def test_the_wall_is_thicker_by_its_folds_and_nowhere_else() -> None:
    duct = DuctScene(thickness_m=WALL_M, cystic=CysticDuctScene(folds=6, fold_height=0.5))
    folded = duct_tubes(duct)[0]
    at_m = np.linspace(1e-3, 20e-3, 200)
    ring = np.array([folded.place(at)[0] + folded.radius_at(at) * folded.place(at)[1][1] for at in at_m])
    corners = folded.folded_m(np.concatenate([ring, ring + 1e-5, ring - 1e-5]))
    mesh = TriangleMesh(corners, np.arange(600).reshape(3, 200).T)
    thickness_m = wall_section(duct, mesh).per_triangle("thickness_m", 200)
    assert thickness_m == pytest.approx(WALL_M + np.linalg.norm(folded.folded_m(ring) - ring, axis=1), abs=3e-5)
    assert thickness_m.max() == pytest.approx(WALL_M + 0.5 * 0.5 * 3.5e-3, rel=0.02)
    assert wall_section(replace(duct, cystic=replace(duct.cystic, folds=0)), mesh).thickness_m == WALL_M


def test_the_common_duct_is_cut_clear_of_the_cystic_duct_at_any_angle() -> None:
    for take_off_rad in (0.35, 0.6, 1.2, 1.6):
        cystic, common = cystic_tubes(CysticDuctScene(take_off_rad=take_off_rad, folds=0), WALL_M)
        end_m, axes = common.place(0.0)
        way = np.array([cystic.place(at)[0] for at in np.linspace(0.0, cystic.length_m, 200)])
        beyond = (way - end_m) @ -axes[0] > -cystic.radii_m.max()
        assert not beyond.any() or np.linalg.norm(way[beyond] - end_m, axis=1).min() > 1.5 * common.radius_m


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ({"length_m": -1e-3}, "duct.cystic.length_m: must be positive"),
        ({"fold_height": 0.95}, "duct.cystic.fold_height"),
        ({"folds": -1}, "duct.cystic.folds: must lie between 0 and 7"),
        ({"folds": 8}, "duct.cystic.folds: must lie between 0 and 7, for which 30 mm have room, is 8"),
        ({"take_off_rad": 0.0}, "duct.cystic.take_off_rad"),
        ({"course": "alpha", "length_m": 15e-3}, "too short for this course"),
    ],
)
def test_a_value_that_makes_no_duct_is_refused(said: dict, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        cystic_tubes(CysticDuctScene(**said), WALL_M)


def test_it_is_one_body_with_the_common_duct() -> None:
    tubes = cystic_tubes(CysticDuctScene(seed=1, folds=0), WALL_M)
    way = np.concatenate([tube.place(at)[0][None] for tube in tubes for at in np.linspace(0.0, tube.length_m, 50)])
    assert union_distance_m(tubes, way).max() < 0.0


def test_the_mouth_is_cut_where_the_common_duct_passes_close_by() -> None:
    """One of sixty patients: short, at a sharp angle, thick; the cut at the mouth nicked the common duct."""
    beside = CysticDuctScene(seed=164250419, common_length_m=20e-3)
    mesh = branching_mesh(duct_tubes(DuctScene(cystic=beside, thickness_m=1.417e-3)), 0.83e-3)
    openings = find_openings(mesh)
    assert len(openings) == 3
    widths_m = sorted(opening.diameter_m for opening in openings)
    drawn = drawn_cystic_duct(beside)
    said_m = sorted([drawn.width_m + 1.417e-3, drawn.common_width_m + 1.417e-3, drawn.common_width_m + 1.417e-3])
    np.testing.assert_allclose(widths_m, said_m, rtol=0.02)
