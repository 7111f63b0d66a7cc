"""Segments of tools against segments of the catheter."""

import numpy as np
import pytest

from trocar.services.mechanics.collision.capsules import CapsuleMemory, capsules_at, detect_capsules
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, JAW_A, ContactPairs, pairs_at
from trocar.services.mechanics.compiled import building_kernel

JAW_M, CATHETER_M, MARGIN_M = 1e-3, 0.8e-3, 0.5e-3
AWAY = np.full((2, 3), 1.0)


class Jaw:
    """One jaw of one tool, and what it remembers of a catheter of so many segments."""

    def __init__(self, n_segments: int) -> None:
        self.memory = CapsuleMemory.zeros(m=6, n=n_segments)

    def meets(self, start_m, end_m, particles_m) -> ContactPairs:
        segments, radius, pairs = np.zeros((2, 3, 2, 3)), np.zeros((2, 3)), ContactPairs.zeros(capacity=64)
        segments[:] = AWAY
        segments[0, JAW_A] = start_m, end_m
        radius[0, JAW_A] = JAW_M
        tools, sizes = (
            (segments, radius, np.array([True, False])),
            (np.full(len(particles_m) - 1, CATHETER_M), MARGIN_M),
        )
        _detect((self.memory.address, pairs.address), tools, np.asarray(particles_m, float), sizes)
        assert (pairs.target_kind[: pairs.count] == CATHETER_SEGMENT).all()
        return pairs


@building_kernel
def _detect(addresses, tools, particles_m, sizes):
    detect_capsules(capsules_at(addresses[0]), pairs_at(addresses[1]), tools, particles_m, sizes)


def bar(first_m=90e-3, last_m=100e-3, n=6):
    return np.stack([np.linspace(first_m, last_m, n), np.zeros(n), np.zeros(n)], axis=1)


@pytest.mark.parametrize("speed_m_s", [0.05, 1.0, 2.5])
def test_no_catheter_passes_through_a_jaw(speed_m_s):
    """Crossed bars pushed through each other: the normal stays that of the side they came from."""
    jaw = Jaw(5)
    for y in np.arange(5e-3, -1.5e-3, -speed_m_s * 1e-3):
        found = jaw.meets([95.3e-3, y, -7e-3], [95.3e-3, y, 7e-3], bar())
        if y <= JAW_M + CATHETER_M:
            k = int(found.gap_m[: found.count].argmin())
            assert found.normal[k, 1] == pytest.approx(1.0)
            assert found.gap_m[k] == pytest.approx(y - JAW_M - CATHETER_M, abs=1e-12)
    assert y <= 0.0


@pytest.mark.parametrize(("gap_m", "is_row", "is_remembered"), [(0.4e-3, 1, 1), (1.9e-3, 0, 1), (2.1e-3, 0, 0)])
def test_a_pair_is_remembered_from_as_far_as_a_step_may_bring_it_together(gap_m, is_row, is_remembered):
    jaw, y = Jaw(1), JAW_M + CATHETER_M + gap_m
    found = jaw.meets([95.3e-3, y, -7e-3], [95.3e-3, y, 7e-3], bar(90e-3, 100e-3, 2))
    assert (found.count, jaw.memory.active[JAW_A, 0]) == (is_row, is_remembered)


def test_a_catheter_may_go_around_the_tip_of_a_jaw():
    jaw, radius = Jaw(1), JAW_M + CATHETER_M + 0.1e-3
    for angle in np.linspace(-0.5 * np.pi, 1.5 * np.pi, 200):
        tip = np.array([105e-3, radius * np.cos(angle), radius * np.sin(angle)])
        found = jaw.meets(tip * [1, 10, 10], tip, bar(100e-3, 110e-3, 2))
        assert found.gap_m[0] == pytest.approx(0.1e-3, abs=1e-9)


def test_a_catheter_along_a_jaw_is_carried_by_spread_points():
    found = Jaw(50).meets([80e-3, 1.75e-3, 0.0], [95e-3, 1.75e-3, 0.0], bar(60e-3, 160e-3, 51))
    assert 8 <= found.count <= 10, "one a segment"
    assert np.ptp(found.tool_parameter[: found.count]) > 0.7
