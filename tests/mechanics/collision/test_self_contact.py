"""The catheter on itself."""

import numpy as np
import pytest

from trocar.services.mechanics.collision.capsules import CapsuleMemory, detect_self, self_clearance_m
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, ContactPairs

RADIUS_M, MARGIN_M, N_APART = 0.8e-3, 0.5e-3, 4


def detect(memory, positions, margin_m=MARGIN_M):
    pairs = ContactPairs.zeros(capacity=64)
    detect_self((memory.address, pairs.address), positions, N_APART, (2.0 * RADIUS_M, margin_m))
    return pairs


def loop_of(n=60, radius_m=12e-3, rise_m=4e-3):
    turn = np.linspace(0.0, 2.4 * np.pi, n)
    return np.stack([radius_m * np.cos(turn), radius_m * np.sin(turn), rise_m * turn / (2.0 * np.pi)], axis=1)


def test_a_loop_meets_itself_and_is_not_drawn_through():
    memory = CapsuleMemory.zeros(m=59, n=59)
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
    assert detect(CapsuleMemory.zeros(m=50, n=50), straight, 0.1e-3).count == 0


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
