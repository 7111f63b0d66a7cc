"""Measures of motion against closed forms: least-jerk movements, circles, sines, and noise that is no way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trocar.review.attempts import motion
from trocar.review.attempts.metrics import force_metrics

HZ = 250.0


def least_jerk(length_m: float, seconds: float, rate_hz: float = HZ) -> np.ndarray:
    t = np.arange(round(seconds * rate_hz) + 1) / (seconds * rate_hz)
    return length_m * (10 * t**3 - 15 * t**4 + 6 * t**5)


def along_x(way_m: np.ndarray) -> np.ndarray:
    return np.column_stack([way_m, np.zeros((len(way_m), 2))])


def times(values: np.ndarray, rate_hz: float = HZ) -> np.ndarray:
    return np.arange(len(values)) / rate_hz


def resampled(path_m: np.ndarray) -> np.ndarray:
    return motion.resampled(times(path_m), path_m)


def test_a_least_jerk_movement_has_the_published_smoothness() -> None:
    speed = np.gradient(least_jerk(0.1, 1.0, 1000.0), 1e-3)
    assert motion.log_dimensionless_jerk(speed, 1000.0) == pytest.approx(-math.log(204.8), abs=0.01)
    assert motion.sparc(speed, 1000.0) == pytest.approx(-1.40, abs=0.02)


def test_smoothness_at_the_rate_of_the_metrics_is_that_of_the_curve() -> None:
    """50 Hz: the speed itself, so that only the measure errs."""
    t = np.arange(51) / 50.0
    speed = 30 * t**2 - 60 * t**3 + 30 * t**4
    assert motion.log_dimensionless_jerk(speed) == pytest.approx(-math.log(204.8), abs=0.02)
    assert motion.sparc(speed) == pytest.approx(-1.40, abs=0.02)


def test_two_movements_in_one_are_less_smooth_than_one() -> None:
    one, other = least_jerk(0.1, 1.0, 50.0), least_jerk(0.1, 1.0, 50.0)
    once = motion.speed(along_x(least_jerk(0.2, 2.0, 50.0)))
    twice = motion.speed(along_x(np.concatenate([one, 0.1 + other[1:]])))
    assert motion.sparc(twice) < motion.sparc(once)
    assert motion.log_dimensionless_jerk(twice) < motion.log_dimensionless_jerk(once)


def test_smoothness_depends_neither_on_size_nor_on_duration() -> None:
    short, long = (motion.speed(along_x(least_jerk(*way, 50.0))) for way in ((0.05, 2.0), (0.3, 4.0)))
    assert motion.log_dimensionless_jerk(short) == pytest.approx(motion.log_dimensionless_jerk(long), abs=0.05)


def test_a_circle_is_as_long_as_its_circumference() -> None:
    turns = 2.0 * math.pi * 0.5 * np.arange(2501) / HZ  # five turns in ten seconds
    path = resampled(0.03 * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))]))
    assert motion.path_length(path) == pytest.approx(5 * 2 * math.pi * 0.03, rel=2e-3)


@pytest.mark.parametrize(("noise_m", "step_m"), [(0.0, 0.055e-3), (0.02e-3, 0.0), (0.05e-3, 0.0)])
def test_noise_and_quantisation_are_no_way(noise_m: float, step_m: float) -> None:
    chance = np.random.default_rng(3)
    there_and_back = np.concatenate([least_jerk(0.1, 2.0), 0.1 - least_jerk(0.1, 2.0)[1:]])
    aslant = np.array([0.8, 0.5, 0.332])  # axes that are quantised one after the other
    path = np.outer(np.tile(there_and_back, 8), aslant / np.linalg.norm(aslant))
    seen = path + noise_m * chance.standard_normal(path.shape)
    if step_m:
        seen = step_m * np.round(seen / step_m)
    assert motion.path_length(seen) > 1.015 * 1.6
    assert motion.path_length(resampled(seen)) == pytest.approx(1.6, rel=0.0015)


def test_lost_ticks_change_no_way() -> None:
    way = along_x(least_jerk(0.1, 2.0))
    kept = np.random.default_rng(4).random(len(way)) > 0.2
    kept[[0, -1]] = True
    assert motion.path_length(motion.resampled(times(way)[kept], way[kept])) == pytest.approx(0.1, rel=1e-3)


def test_depth_is_the_way_along_the_tool() -> None:
    way, angle = least_jerk(0.1, 2.0), math.radians(30.0)
    path = np.column_stack([way * math.cos(angle), way * math.sin(angle), np.zeros(len(way))])
    axes = np.tile([1.0, 0.0, 0.0], (len(way), 1))
    assert motion.depth_length(path, axes) == pytest.approx(0.1 * math.cos(angle), rel=1e-9)


def test_the_motion_frequency_of_a_sine_is_its_own() -> None:
    t = np.arange(500) / 50.0
    assert motion.motion_frequency(0.1 + 0.02 * np.sin(2 * math.pi * 3.0 * t)) == pytest.approx(3.0, abs=0.1)


def test_movements_are_told_by_the_rests_between() -> None:
    parts = [least_jerk(0.05, 1.0, 50.0), np.full(50, 0.05)]
    way = np.concatenate([*parts, *(0.05 + part for part in parts), *(0.1 + part for part in parts)])
    found = motion.movements(motion.speed(along_x(way)))
    assert len(found) == 3
    assert [(part.stop - part.start) / 50.0 for part in found] == pytest.approx([1.0] * 3, abs=0.15)
    assert motion.movements(np.zeros(100)) == []


def test_force_over_its_limit_is_integrated() -> None:
    """F = 2 sin(t) N over half a turn, limit 1 N: above from pi/6 to 5 pi/6, load 2 sqrt(3) - 2 pi/3."""
    t = np.linspace(0.0, math.pi, 20001)
    found = force_metrics(t, 2.0 * np.sin(t), 1.0)
    assert found["peak_n"] == pytest.approx(2.0, rel=1e-6)
    assert found["rms_n"] == pytest.approx(math.sqrt(2.0), rel=1e-3)
    assert found["mean_n"] == pytest.approx(4.0 / math.pi, rel=1e-3)
    assert found["above_limit_s"] == pytest.approx(2.0 * math.pi / 3.0, abs=1e-3)
    assert found["load_n_s"] == pytest.approx(2.0 * math.sqrt(3.0) - 2.0 * math.pi / 3.0, abs=1e-3)
