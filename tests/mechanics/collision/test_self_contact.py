"""The catheter on itself, and stones on the catheter."""

import numpy as np
import pytest

from trocar.services.mechanics.collision.capsules import CapsuleMemory, capsules_at
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, ContactPairs, pairs_at
from trocar.services.mechanics.collision.pieces import N_TOOL_PIECES
from trocar.services.mechanics.collision.strands import detect_spheres, detect_strands, self_clearance_m
from trocar.services.mechanics.compiled import building_kernel

RADIUS_M, MARGIN_M, N_APART, STONE_M = 0.8e-3, 0.5e-3, 4, 1.5e-3


def memory_of(n, n_spheres=0):
    return CapsuleMemory.zeros(m=N_TOOL_PIECES + n + n_spheres, n=n, n_apart=N_APART)


def detect(memory, positions, margin_m=MARGIN_M):
    pairs = ContactPairs.zeros(capacity=64)
    radii_m = np.full(len(positions), RADIUS_M)
    _detect_strands((memory.address, pairs.address), positions, (radii_m, margin_m))
    return pairs


@building_kernel
def _detect_strands(addresses, positions, sizes):
    detect_strands(capsules_at(addresses[0]), pairs_at(addresses[1]), positions, sizes)


def detect_sphere(memory, positions, centre_m, motion_m):
    pairs = ContactPairs.zeros(capacity=64)
    radii_m = np.full(len(positions), RADIUS_M)
    sphere = np.array([centre_m], float), np.array([motion_m], float), np.array([STONE_M])
    _detect_spheres((memory.address, pairs.address), sphere, np.asarray(positions, float), (radii_m, MARGIN_M))
    return pairs


@building_kernel
def _detect_spheres(addresses, spheres, positions, sizes):
    detect_spheres(capsules_at(addresses[0]), pairs_at(addresses[1]), spheres, 1, positions, sizes)


def loop_of(n=60, radius_m=12e-3, rise_m=4e-3):
    turn = np.linspace(0.0, 2.4 * np.pi, n)
    return np.stack([radius_m * np.cos(turn), radius_m * np.sin(turn), rise_m * turn / (2.0 * np.pi)], axis=1)


def test_a_loop_meets_itself_and_is_not_drawn_through():
    memory = memory_of(59)
    seen = 0
    for rise in np.arange(4e-3, -1e-3, -0.05e-3):
        found = detect(memory, loop_of(rise_m=rise))
        n = found.count
        if rise > 2.0 * RADIUS_M + MARGIN_M + 0.1e-3:
            assert n == 0
        if rise > 2.0 * RADIUS_M + MARGIN_M - 0.1e-3:
            continue
        seen += 1
        assert (found.target_kind[:n] == CATHETER_SEGMENT).all()
        deepest = int(np.argmin(found.gap_m[:n]))
        assert found.gap_m[deepest] == pytest.approx(rise - 2.0 * RADIUS_M, abs=0.1e-3)
        assert found.particle[deepest] < found.target[deepest]
        assert found.normal[deepest, 2] < -0.9, "the first turn lies below the second and stays there"
    assert seen > 40


def test_neighbours_do_not_meet():
    straight = np.stack([np.linspace(0.0, 0.1, 51), np.zeros(51), np.zeros(51)], axis=1)
    assert detect(memory_of(50), straight, 0.1e-3).count == 0


def test_a_catheter_that_may_not_touch_itself_has_no_pairs():
    memory = memory_of(59)
    memory.n_apart = 0
    assert detect(memory, loop_of(rise_m=1e-3)).count == 0


def crossed(height_m, at=0.5, n=20, length_m=20e-3):
    """A strand along x, and a second one along y that crosses it so high above, at a place within a segment of it."""
    first = np.stack([np.linspace(-length_m, length_m, n + 1), np.zeros(n + 1), np.zeros(n + 1)], axis=1)
    first[:, 0] += (at - 0.5) * 2.0 * length_m / n
    second = np.stack([np.zeros(n + 1), np.linspace(-length_m, length_m, n + 1), np.full(n + 1, height_m)], axis=1)
    return np.concatenate([first, second])


@pytest.mark.parametrize("at", [0.5, 0.0, 1.0, 0.25])
def test_strands_keep_their_sides_beyond_each_others_axes_also_at_a_joint(at):
    """At a joint the closest point is an end of both segments, but no end of the catheter."""
    memory = memory_of(41)
    for height_m in np.arange(2e-3, -1.0e-3, -0.05e-3):
        found = detect(memory, crossed(height_m, at))
        n = found.count
        deepest = int(np.argmin(found.gap_m[:n]))
        assert found.gap_m[deepest] == pytest.approx(height_m - 2.0 * RADIUS_M, abs=1e-9)
        assert found.normal[deepest, 2] < -0.9, "the first strand stays below"


def test_strands_that_slide_on_each_other_while_they_overlap_deeply_keep_their_sides():
    """Within half of their thickness the direction between their axes is that of the sliding, not the side."""
    memory = memory_of(41)
    line = crossed(1.7e-3)
    along = np.array([1.0, 0.0, 0.0])
    line[21:] = along * np.linspace(20e-3, -20e-3, 21)[:, None] + [0.0, 0.0, 1.7e-3]
    detect(memory, line)
    for aside_m in np.arange(0.0, 0.3e-3, 0.02e-3):
        for height_m in (0.1e-3, 0.0, -0.1e-3):
            line[21:, 1:] = aside_m, height_m
            found = detect(memory, line)
            n = found.count
            assert (found.normal[:n, 2][found.gap_m[:n] < 0.0] < -0.9).all()
            assert found.gap_m[:n].min() == pytest.approx(height_m - 2.0 * RADIUS_M, abs=1e-9)


@pytest.mark.parametrize("x_m", [0.5e-3, 0.0])
def test_a_stone_keeps_its_side_of_the_catheter_beyond_its_axis(x_m):
    line = np.outer(np.arange(-10.0, 11.0), (2e-3, 0.0, 0.0))
    memory = memory_of(20, 1)
    for height_m in np.arange(2.5e-3, -1.0e-3, -0.05e-3):
        found = detect_sphere(memory, line, (x_m, 0.0, height_m), (0.0, 0.0, 0.0))
        touches = found.gap_m[: found.count] < 0.0
        if x_m == 0.0 and height_m > 1.2e-3:
            assert np.count_nonzero(touches) <= 1, "one pair at a joint"
        if height_m < STONE_M + RADIUS_M:
            k = int(np.argmin(found.gap_m[: found.count]))
            assert found.gap_m[k] == pytest.approx(height_m - STONE_M - RADIUS_M, abs=1e-9)
            assert found.normal[k, 2] > 0.9
            assert found.particle[k] == 20, "spheres are numbered after the segments"


def test_a_fast_stone_is_looked_for_further_away():
    line = np.outer(np.arange(-10.0, 11.0), (2e-3, 0.0, 0.0))
    away_m = (0.3e-3, 0.0, STONE_M + RADIUS_M + 1.0e-3)
    assert detect_sphere(memory_of(20, 1), line, away_m, (0.0, 0.0, 0.0)).count == 0
    assert detect_sphere(memory_of(20, 1), line, away_m, (0.0, 0.0, -1.2e-3)).count > 0


@pytest.mark.parametrize("rise_m", [2e-3, 4e-3, 12e-3])
def test_no_strands_are_nearer_than_the_clearance_and_it_is_no_idle_bound(rise_m):
    """Against points every tenth of a segment; midpoints and lengths alone tell it to a segment's length."""
    line, n_apart = loop_of(rise_m=rise_m), 10
    share = np.linspace(0.0, 1.0, 11)[:, None, None]
    points = line[:-1] + share * (line[1:] - line[:-1])
    every = np.linalg.norm(points[:, None, :, None] - points[None, :, None, :], axis=-1).min(axis=(0, 1))
    apart = np.abs(np.subtract.outer(np.arange(59), np.arange(59))) >= n_apart
    gap_m = every[apart].min() - 2.0 * RADIUS_M
    clearance_m = self_clearance_m(line, n_apart, 2.0 * RADIUS_M)
    assert gap_m - np.linalg.norm(np.diff(line, axis=0), axis=1).max() <= clearance_m <= gap_m
