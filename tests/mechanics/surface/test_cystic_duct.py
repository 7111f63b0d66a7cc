"""A cystic duct by its anatomy: what is drawn lies in its ranges, and the tube is what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.scene.cystic_duct import (
    ALPHA_LENGTH,
    COURSES,
    RANGES,
    CysticDuctScene,
    drawn_cystic_duct,
)
from trocar.services.mechanics.scene.cystic_tubes import cystic_tubes
from trocar.services.mechanics.surface.branched_tubes import union_distance_m
from trocar.services.mechanics.surface.curved_tube import CurvedTube

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


def test_folds_wind_round_the_half_towards_the_gallbladder() -> None:
    bare, folded = (trunk(CysticDuctScene(folds=n, fold_height=0.4)) for n in (0, 6))
    at_m = np.linspace(0.0, bare.length_m, 1200)
    side = bare.place(0.0)[1][1]
    wall = np.array([bare.place(at)[0] for at in at_m]) + bare.radius_at(0.0) * side
    inward_m = folded.distance_m(wall) - bare.distance_m(wall)
    peaks = (inward_m[1:-1] > inward_m[:-2]) & (inward_m[1:-1] >= inward_m[2:]) & (inward_m[1:-1] > 0.3e-3)
    assert 5 <= peaks.sum() <= 7
    assert inward_m.max() == pytest.approx(0.4 * 0.5 * 3.5e-3, rel=0.05)
    assert inward_m[at_m > 0.5 * bare.length_m + 6e-3].max() < 1e-6
    other = np.array([bare.place(at)[0] for at in at_m]) - bare.radius_at(0.0) * side
    half_turn_m = abs(at_m[np.argmax(inward_m)] - at_m[np.argmax(folded.distance_m(other) - bare.distance_m(other))])
    assert half_turn_m % 2.5e-3 == pytest.approx(1.25e-3, abs=0.3e-3)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ({"length_m": -1e-3}, "duct.cystic.length_m: must be positive"),
        ({"fold_height": 0.95}, "duct.cystic.fold_height"),
        ({"folds": -1}, "duct.cystic.folds"),
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
