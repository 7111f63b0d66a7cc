"""The tubes of a cystic duct by its anatomy: the duct along its course, and the common duct that it leaves."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene.cystic_duct import SPIRAL, CysticDuctScene, drawn_cystic_duct, most_folds
from trocar.services.mechanics.surface.branched_tubes import Tube
from trocar.services.mechanics.surface.curved_tube import Folds, curved_tube

STEPS = 400
"""Stations along the duct."""
_MARGIN_M = 5e-3
"""Without folds behind the mouth, where the wall was cut and is held."""
_FOLD_WIDTH = 1.25
"""Of the wall: width of a fold at half its height. It is the wall laid double, so not much thinner than the wall."""
_FOLD_ARC_RAD = 4.0 / 3.0 * math.pi
"""Assumption: how far a crescent reaches round the lumen, two thirds; half of it is higher than half its height."""
_LOOP = 0.8
"""Share of an alpha's length that loops."""
_CLEAR = 4.2
"""Of the outer radius: how far the two limbs of a loop lie from each other where they cross."""

_CLEAR_END = 1.6
"""Of the common duct's radius: how far from the middle of its end another tube must be, for it to be cut there."""


def cystic_tubes(cystic: CysticDuctScene, thickness_m: float) -> list[Tube]:
    """Return the cystic duct, whose near end is the mouth, and the common duct between ``liver`` and ``duodenum``.

    Surfaces are the middle of a wall. The junction is the origin, and the duct goes from there towards +x.
    Raises ValueError that names the key of a value that makes no duct.
    """
    duct = drawn_cystic_duct(cystic)
    radii_m = 0.5 * (_widths_m(duct) + thickness_m)
    points_m = _course_m(duct, float(radii_m.max()))
    _check(duct, points_m, radii_m)
    folds = _folds(duct, thickness_m)
    common = _common_duct(duct, thickness_m, points_m, float(radii_m.max()))
    return [curved_tube("trunk", points_m, radii_m, "on", folds), common]


def _widths_m(duct: CysticDuctScene) -> FloatArray:
    assert duct.width_m is not None
    assert duct.end_width_m is not None
    return np.linspace(duct.width_m, duct.end_width_m, STEPS + 1)


def _course_m(duct: CysticDuctScene, outer_m: float) -> FloatArray:
    """Return the axis (k, 3) from the mouth to the junction at the origin, which it leaves along +x."""
    assert duct.length_m is not None
    assert duct.turn_rad is not None
    along = np.linspace(0.0, 1.0, STEPS + 1)  # from the junction on
    if duct.course == "straight":
        heading, rising = np.zeros_like(along), 0.0
    elif duct.course == "s":
        heading, rising = duct.turn_rad * np.sin(2.0 * np.pi * along), 0.0
    else:
        inside = np.clip((along - 0.5 * (1.0 - _LOOP)) / _LOOP, 0.0, 1.0)
        heading = 2.0 * np.pi * (inside - np.sin(2.0 * np.pi * inside) / (2.0 * np.pi) * 0.5)
        rising = math.asin(min(0.9, _CLEAR * outer_m / (_LOOP * duct.length_m)))
    level = math.cos(rising)
    steps = np.stack(
        [level * np.cos(heading), level * np.sin(heading), np.full_like(heading, math.sin(rising))], axis=1
    )
    middle = 0.5 * (steps[1:] + steps[:-1])
    points = np.concatenate([np.zeros((1, 3)), np.cumsum(middle, axis=0)]) * (duct.length_m / STEPS)
    return points[::-1]


def _folds(duct: CysticDuctScene, thickness_m: float) -> Folds | None:
    assert duct.length_m is not None
    assert duct.width_m is not None
    assert duct.end_width_m is not None
    assert duct.fold_height is not None
    assert duct.fold_side_rad is not None
    if not duct.folds:
        return None
    end_m = SPIRAL * duct.length_m + _MARGIN_M
    pitch_m = (end_m - _MARGIN_M) / duct.folds
    at_m, widths_m = np.array([_MARGIN_M, end_m]), [duct.width_m, duct.end_width_m]
    begin, end = 0.5 * duct.fold_height * np.interp(at_m, [0.0, duct.length_m], widths_m)
    width_m = min(_FOLD_WIDTH * thickness_m, math.pi / _FOLD_ARC_RAD * pitch_m)  # half a turn of their line
    begin_rad = duct.fold_side_rad - 0.5 * _FOLD_ARC_RAD
    return Folds(_MARGIN_M, end_m, pitch_m, float(begin), float(end), width_m, _FOLD_ARC_RAD, begin_rad)


def _common_duct(duct: CysticDuctScene, thickness_m: float, points_m: FloatArray, cystic_m: float) -> Tube:
    """Return the common duct; its part to the liver is at the angle of take-off to the cystic duct.

    At a sharp angle that part is longer than half of it: it ends where it is clear of the cystic duct, of the largest
    radius ``cystic_m``.
    """
    assert duct.take_off_rad is not None
    assert duct.common_width_m is not None
    on = points_m[-2] - points_m[-1]
    on /= np.linalg.norm(on)
    across = np.cross(on, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    up = math.cos(duct.take_off_rad) * on + math.sin(duct.take_off_rad) * across
    radius_m = 0.5 * (duct.common_width_m + thickness_m)
    half_m = 0.5 * duct.common_length_m
    sharp = duct.take_off_rad < 0.5 * math.pi
    clear_m = (_CLEAR_END * radius_m + cystic_m / math.cos(duct.take_off_rad)) / math.tan(duct.take_off_rad)
    liver_m = max(half_m, clear_m) if sharp else half_m
    points = points_m[-1] + np.linspace(liver_m, -half_m, STEPS // 2 + 1)[:, None] * up
    return curved_tube("duodenum", points, np.full(len(points), radius_m), "held", opening="liver")


def _check(duct: CysticDuctScene, points_m: FloatArray, radii_m: FloatArray) -> None:
    for key in ("length_m", "width_m", "end_width_m", "common_width_m", "common_length_m"):
        if not getattr(duct, key) > 0.0:
            raise ValueError(f"duct.cystic.{key}: must be positive, is {getattr(duct, key)}")
    assert duct.folds is not None
    assert duct.length_m is not None
    most = most_folds(duct.length_m)
    if not 0 <= duct.folds <= most:
        raise ValueError(
            f"duct.cystic.folds: must lie between 0 and {most}, for which {1e3 * duct.length_m:g} mm have room, is "
            f"{duct.folds}"
        )
    if duct.fold_height is not None and not 0.0 <= duct.fold_height < 0.9:
        raise ValueError(f"duct.cystic.fold_height: must be at least 0 and below 0.9, is {duct.fold_height}")
    if duct.take_off_rad is not None and not 0.1 <= duct.take_off_rad <= math.pi - 0.1:
        raise ValueError(
            f"duct.cystic.take_off_rad: must lie between 0.1 and {math.pi - 0.1:.3g}, is {duct.take_off_rad}"
        )
    bend = np.linalg.norm(np.gradient(np.gradient(points_m, axis=0), axis=0), axis=1)[3:-3]
    step_m = float(np.linalg.norm(points_m[1] - points_m[0]))
    if (bend / step_m**2 * radii_m[3:-3]).max() >= 0.9:
        raise ValueError(
            "duct.cystic.length_m: is too short for this course and width: the wall would fold onto itself"
        )
