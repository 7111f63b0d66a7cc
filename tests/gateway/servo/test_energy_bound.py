"""A hand gets back at most what all hands have put in."""

from __future__ import annotations

import numpy as np
import pytest

from tests.gateway.servo.test_servo_law import DT_S, Law
from trocar.services.gateway.servo import energy_bound, servo_arrays
from trocar.services.gateway.servo.energy_bound import ADVANCE_J, FORGIVEN_W, MAX_STORED_J
from trocar.services.gateway.servo.servo_arrays import (
    MEMORY_AT_ANCHOR,
    MEMORY_BY_STEPS,
    MEMORY_ENERGY,
    MEMORY_RESERVED,
    NOW_OTHERS,
    NOW_RESERVED,
)
from trocar.services.gateway.simulated.premium_model import COUNT_M, FRICTION_N
from trocar.services.mechanics.arrays import FloatArray

WALL_N_M = 500.0


def at_a_wall(stiffness_n_m: float = WALL_N_M) -> Law:
    law = Law(friction_n=FRICTION_N)
    law.load(stiffness_n_m=(stiffness_n_m, 0, 0, 0, stiffness_n_m, 0, 0, 0, stiffness_n_m), in_contact=True)
    return law


def press(law: Law, to_m: float, speed_m_s: float = 0.01) -> float:
    """Let the hand go along x to a place, in counts of its encoders; return the force there, N."""
    ticks = max(1, round(abs(to_m - law.motion[0]) / (speed_m_s * DT_S)))
    for x in np.linspace(law.motion[0], to_m, ticks + 1)[1:]:
        law.motion[0] = np.floor(x / COUNT_M) * COUNT_M
        force = law.force()
    return float(force[0])


def own(law: Law, energy_j: float) -> None:
    law.memory[[MEMORY_ENERGY, MEMORY_BY_STEPS, MEMORY_AT_ANCHOR]] = energy_j


@pytest.mark.parametrize("stiffness_n_m", [50.0, 600.0, 1300.0])
def test_a_slow_hand_feels_the_wall_and_nothing_of_the_bound(stiffness_n_m: float) -> None:
    law = at_a_wall(stiffness_n_m)
    for place_m in (-0.3e-3, -1e-3, -1.5e-3, -0.5e-3, -2e-3, -0.2e-3):
        press(law, place_m)
        assert law.force()[0] == pytest.approx(-stiffness_n_m * law.motion[0], rel=1e-9)


def test_a_hand_that_rests_on_the_edge_of_a_count_keeps_its_force() -> None:
    """What flickers is not a hand that works: a wall of 38 % of friction over a count, 10 s long."""
    law = at_a_wall()
    press(law, -1e-3)
    for tick in range(10_000):
        law.motion[0] = -1e-3 + COUNT_M * (tick % 2)
        assert law.force()[0] == pytest.approx(-WALL_N_M * law.motion[0])


@pytest.mark.parametrize("stiffness_n_m", [50.0, WALL_N_M, 1300.0])
@pytest.mark.parametrize("axes", [1, 3])
def test_a_tip_that_stands_on_the_edge_of_a_count_earns_nothing(stiffness_n_m: float, axes: int) -> None:
    """Its friction dissipates nothing: so much earned would pay for a fast withdrawal."""
    law = at_a_wall(stiffness_n_m)
    press(law, -1e-3)
    stored_j, edge_m = law.memory[MEMORY_ENERGY], law.motion[:3].copy()
    for tick in range(10_000):
        law.motion[:axes] = edge_m[:axes] + COUNT_M * (tick % 2)
        law.force()
        assert law.memory[MEMORY_ENERGY] <= stored_j + 2.0 * stiffness_n_m * COUNT_M**2, "what the last step may hold"


def test_a_force_that_nobody_paid_for_is_no_more_than_the_arms_friction() -> None:
    """A wall that appears behind a hand, or came to it: the hand has done nothing, and gets nothing."""
    law = Law(friction_n=FRICTION_N)
    law.load(force_n=(2.0, 0.0, 0.0), in_contact=True)
    assert law.settle()[0] == pytest.approx(FRICTION_N)


def test_without_any_friction_a_force_begins_with_an_advance_and_only_once() -> None:
    law = Law(friction_n=0.0)
    law.load(force_n=(2.0, 0.0, 0.0), in_contact=True)
    assert law.settle()[0] == pytest.approx(ADVANCE_J / (2.0 * COUNT_M))
    given_j = 0.0
    for tick in range(2000):
        before_m, force_n = law.motion[0], law.memory[0]
        law.motion[0] = 1e-3 * abs(np.sin(0.01 * tick))
        given_j += force_n * (law.motion[0] - before_m)
        law.load(force_n=(2.0 * (tick % 2), 0.0, 0.0), in_contact=tick % 2)
        law.force()
    assert given_j <= ADVANCE_J + 2.0 * FORGIVEN_W


def test_what_another_hand_has_put_in_pushes_this_one() -> None:
    law = Law(friction_n=FRICTION_N)
    law.now[NOW_OTHERS] = 0.01
    law.load(force_n=(2.0, 0.0, 0.0), in_contact=True)
    assert law.settle()[0] == pytest.approx(2.0)
    for _ in range(40):
        law.motion[0] += 0.2e-3
        law.force()
    given_j = -law.memory[MEMORY_ENERGY]
    assert 0.009 < given_j <= 0.01, "it is pushed until that is spent"
    assert law.force()[0] == pytest.approx(FRICTION_N, rel=0.5)


@pytest.mark.parametrize("speeds_m_s", [(1.0, 1.0), (1.2, 0.3), (0.3, 1.2)])
def test_two_hands_that_draw_back_in_the_same_ticks_do_not_spend_what_one_put_in_twice(
    speeds_m_s: tuple[float, float],
) -> None:
    """One pushed the other through tissue, and both left: 3 mJ more came out of two arms than went in."""
    hands = [Law(friction_n=FRICTION_N) for _ in range(2)]
    for hand, energy_j in zip(hands, (0.017, -0.013), strict=True):
        hand.load(force_n=(3.0, 0.0, 0.0), in_contact=True)
        own(hand, energy_j)
    for tick in range(60):
        for hand, other, speed_m_s in zip(hands, reversed(hands), speeds_m_s, strict=True):
            hand.motion[0] += speed_m_s * DT_S * min(1.0, 0.1 * tick)
            hand.now[[NOW_OTHERS, NOW_RESERVED]] = other.memory[[MEMORY_ENERGY, MEMORY_RESERVED]]
            hand.force()
    assert sum(hand.memory[MEMORY_ENERGY] for hand in hands) >= 0.0


def test_a_late_model_gives_back_what_was_put_in_and_no_more() -> None:
    """The wall stays where it was when the hand pressed: without a bound it would push all the way out."""
    law = at_a_wall()
    press(law, -2e-3)
    stored_j = law.memory[MEMORY_ENERGY]
    assert stored_j == pytest.approx(0.5 * WALL_N_M * 2e-3**2, rel=0.03)
    law.load(force_n=(1.0, 0.0, 0.0), in_contact=True)
    given_j, before_m = 0.0, law.motion[0]
    for _ in range(15):
        force = law.memory[0]
        law.motion[0] += 0.5e-3
        given_j += (force - FRICTION_N) * (law.motion[0] - before_m)
        before_m = law.motion[0]
        law.force()
    assert given_j <= stored_j + 1e-12
    assert law.force()[0] < 1.01 * FRICTION_N


def test_a_free_hand_has_no_savings_but_for_what_others_have_drawn_on_and_debts_are_forgiven() -> None:
    law = at_a_wall()
    press(law, -2e-3)
    law.load()
    law.settle()
    assert law.memory[MEMORY_ENERGY] == 0.0
    own(law, 0.004)
    law.now[NOW_OTHERS] = -0.003
    law.force()
    assert law.memory[MEMORY_ENERGY] == pytest.approx(0.003), "it pays for what another was given"
    own(law, -0.002)
    law.now[NOW_OTHERS] = 0.002
    law.force()
    assert law.memory[MEMORY_ENERGY] == pytest.approx(-0.002), "that is paid for"


def test_a_debt_is_paid_by_the_friction_of_a_hand_that_moves_and_hardly_by_time() -> None:
    law = at_a_wall()
    law.load()
    own(law, -0.002)
    for _ in range(1000):
        law.force()
    assert law.memory[MEMORY_ENERGY] == pytest.approx(-0.002 + FORGIVEN_W, rel=1e-6)
    for tick in range(1000):
        law.motion[0] = 1e-5 * (tick % 50)
        law.force()
    way_m = 1e-5 * (20 * 49 + 19 * 49)
    assert law.memory[MEMORY_ENERGY] == pytest.approx(-0.002 + FRICTION_N * way_m, rel=0.01)


def test_long_friction_is_not_saved_for_a_burst() -> None:
    law = Law(friction_n=FRICTION_N)
    for _ in range(3000):
        law.load(force_n=(-2.0, 0.0, 0.0), in_contact=True)
        law.motion[0] += 0.1e-3
        law.force()
    assert law.memory[MEMORY_ENERGY] == MAX_STORED_J


def books(force_n: float, acting_n: float, energy_j: float) -> FloatArray:
    """Books of an arm on one axis: the force to be written, the one that still acts, and the balance."""
    memory = np.zeros(servo_arrays.MEMORY_SIZE)
    memory[servo_arrays.MEMORY_FORCE], memory[servo_arrays.MEMORY_FLIGHTS] = force_n, acting_n
    memory[servo_arrays.MEMORY_ENERGY] = energy_j
    return memory


@pytest.mark.parametrize(
    ("force_n", "energy_j", "left_n", "reserved_j"),
    [(0.1, 1e-3, 0.1, 1e-4), (1.0, 1.2e-4, 0.3, 1.2e-4)],
    ids=["enough for both", "enough for the one that acts, and a part of the next"],
)
def test_a_force_that_still_acts_for_a_tick_is_paid_for_before_the_next(
    force_n: float, energy_j: float, left_n: float, reserved_j: float
) -> None:
    """Friction bears 0.05 N of either; the hand goes 0.1 mm a tick along the force, and a force comes a tick late."""
    limits, now, step = np.zeros(servo_arrays.OWN_SIZE), np.zeros(servo_arrays.NOW_SIZE), (1e-4, 0.0, 0.0)
    limits[servo_arrays.OWN_FRICTION] = 0.05
    now[servo_arrays.NOW_DT] = now[servo_arrays.NOW_LATE_S] = DT_S
    memory = books(force_n, 1.0, energy_j)
    memory[servo_arrays.MEMORY_WAY] = step[0]
    energy_bound.bound_force(step, limits, now, memory)
    assert memory[servo_arrays.MEMORY_FORCE] == pytest.approx(left_n)
    assert memory[servo_arrays.MEMORY_RESERVED] == pytest.approx(reserved_j)


@pytest.mark.parametrize(("returned", "paid_j"), [(0.0, 0.05e-4), (1.0, 0.0)])
def test_friction_pays_no_debt_over_a_way_on_which_the_hand_was_given_energy(returned: float, paid_j: float) -> None:
    """What friction took there is left out already of what the hand was given."""
    limits, now = np.zeros(servo_arrays.OWN_SIZE), np.zeros(servo_arrays.NOW_SIZE)
    limits[servo_arrays.OWN_FRICTION] = 0.05
    memory = books(0.0, 0.0, -1e-3)
    memory[servo_arrays.MEMORY_RETURNED] = returned
    energy_bound.settle_energy((1e-4, 0.0, 0.0), limits, now, False, memory)
    assert memory[servo_arrays.MEMORY_ENERGY] + 1e-3 == pytest.approx(paid_j, abs=1e-9)
