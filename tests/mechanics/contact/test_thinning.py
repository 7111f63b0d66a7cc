"""A rung on which fewer particles touch gives up contacts that are near, never one that bears or is about to."""

import numpy as np
import pytest

from services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, ContactPairs
from services.mechanics.contact.thinning import thin_pairs

N, TIP, DT_S, MASS_KG = 9, 8, 1e-3, 3e-6
WEIGHT_N = 9.81 * MASS_KG


def pairs_of_all_particles(gap_m):
    """Every particle above a wall whose normal is +z."""
    pairs = ContactPairs.allocate(2 * N)
    pairs.count = N
    pairs.particle[:N], pairs.target_kind[:N], pairs.gap_m[:N] = np.arange(N), DUCT_TRIANGLE, gap_m
    pairs.normal[:N] = 0.0, 0.0, 1.0
    return pairs


def kept(pairs, every=4, velocity=(0.0, 0.0, 0.0), against_m=((0.0, 0.0, 0.0),) * 2, force_n=(0.0, 0.0, 0.0)):
    """``against_m`` is (2, 3) for all particles or (n, 3) for both minima of each; the others (3,) or (n, 3)."""
    against_m = np.asarray(against_m)
    by_minimum = np.tile(against_m, (N, 1, 1)) if len(against_m) == 2 else np.stack([against_m, against_m], axis=1)
    alike = [np.ascontiguousarray(np.broadcast_to(each, (N, 3)), dtype=np.float64) for each in (velocity, force_n)]
    rod = alike[0], by_minimum, alike[1], np.full(N, MASS_KG)
    thin_pairs(pairs.address, rod, (every, TIP), DT_S)
    return pairs.particle[: pairs.count].tolist()


def test_of_what_is_only_near_one_in_so_many_is_kept_from_the_tip_on():
    assert kept(pairs_of_all_particles(5e-5)) == [0, 4, 8]
    assert kept(pairs_of_all_particles(5e-5), every=3) == [2, 5, 8]


@pytest.mark.parametrize("particle", [1, 2, 3, 5])
def test_what_overlaps_by_more_than_a_twentieth_of_a_millimetre_is_kept_whatever_its_number(particle):
    gap_m = np.full(N, -4.9e-5)
    assert kept(pairs_of_all_particles(gap_m)) == [0, 4, 8]
    gap_m[particle] = -5.1e-5
    assert kept(pairs_of_all_particles(gap_m)) == sorted({0, 4, 8, particle})


def test_what_bears_more_than_five_times_its_weight_is_kept():
    assert kept(pairs_of_all_particles(0.0), force_n=(0.0, 0.0, 5.0 * WEIGHT_N)) == [0, 4, 8]
    assert kept(pairs_of_all_particles(0.0), force_n=(0.0, 3.7 * WEIGHT_N, 3.7 * WEIGHT_N)) == list(range(N))


def test_what_reaches_the_wall_within_the_step_is_kept():
    assert kept(pairs_of_all_particles(4e-4), velocity=(0.0, 0.0, -0.5)) == list(range(N))
    assert kept(pairs_of_all_particles(6e-4), velocity=(0.0, 0.0, -0.5)) == [0, 4, 8]
    assert kept(pairs_of_all_particles(4e-4), velocity=(0.5, 0.0, 0.5)) == [0, 4, 8], "along the wall, and away"


@pytest.mark.parametrize("minimum", [0, 1])
def test_what_the_wall_comes_to_within_the_step_is_kept(minimum):
    """A wall that came to a catheter at rest by 0.23 mm a step was 0.13 mm in it: its own motion was asked."""
    against_m = np.zeros((2, 3))
    against_m[minimum, 2] = -0.23e-3
    assert kept(pairs_of_all_particles(1.7e-4), against_m=against_m) == list(range(N))
    assert kept(pairs_of_all_particles(1.9e-4), against_m=against_m) == [0, 4, 8]
    assert kept(pairs_of_all_particles(1.7e-4), against_m=-against_m) == [0, 4, 8], "away"


@pytest.mark.parametrize("s", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("first", [1, 2, 5])
def test_of_a_place_between_two_particles_both_are_asked(first, s):
    """A segment on the mouth's edge belongs to its first particle, and nearly all of it may be the second's.

    Given up by turns, on a ladder that changes in every tick, it let the catheter sink in by 9 um: that never rested.
    """
    share, rest = np.array([1.0 - s, s]), dict.fromkeys(("velocity", "against_m", "force_n"), np.zeros((N, 3)))
    for name, enough in (("velocity", -0.5), ("against_m", -0.5e-3), ("force_n", 5.1 * WEIGHT_N)):
        for of_enough, is_needed in ((0.98, False), (1.02, True)):
            moved = np.zeros((N, 3))
            moved[first : first + 2, 2] = of_enough * enough * share / (share @ share)
            pairs = pairs_of_all_particles(np.inf)
            pairs.count, pairs.particle[0], pairs.tool_parameter[0] = 1, first, s
            pairs.gap_m[0] = 0.45e-3 if name != "force_n" else 0.0
            assert (kept(pairs, **{**rest, name: moved}) == [first]) == is_needed, (name, of_enough)


def test_pairs_of_tools_and_with_other_segments_are_not_its_business():
    pairs = pairs_of_all_particles(5e-5)
    pairs.tool[1], pairs.target_kind[2] = 0, CATHETER_SEGMENT
    assert kept(pairs) == [0, 1, 2, 4, 8]
