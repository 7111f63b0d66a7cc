"""Laws beside each other: what theory says of each, at one wall, with the same hands."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.studies.feel.compare import (
    GAIN_J,
    LAWS,
    TICK_S,
    TRIED_N_M,
    Hands,
    arm_file,
    drawn_hands,
    met_and_left,
    move,
    noticed,
    rendered,
    stiffest_passive,
)
from trocar.studies.feel.laws import VISCOUS_N_S_M, Walls

PREMIUM, RIG, SPRING = "phantom_premium_1_5", "the rig's, energy bounded", "a spring alone"
EBA, TDPA, CHAI3D, OPENHAPTICS = (
    "energy bounding (EBA)", "passivity observer (TDPA)", "as CHAI3D", "as OpenHaptics",
)  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
def test_every_law_renders_a_soft_wall_as_it_is_and_nothing_beside_it(law: str) -> None:
    assert rendered(law, PREMIUM, 80.0) == pytest.approx(80.0, rel=0.05)
    hands = drawn_hands(5, 0)
    beside = Hands(hands.target_m + 0.05, hands.stiffness_n_m, hands.damping_n_s_m)
    away = move(law, PREMIUM, np.full(5, 500.0), beside)
    assert not away.force_n.any()


def test_a_spring_alone_gives_energy_from_where_theory_says_that_friction_does_not_take_it_any_more() -> None:
    """Colgate and Schenkel: b > K T / 2; dry friction and the count's rounding move the border, not its order."""
    hands = drawn_hands(40, 0)
    stiffest = stiffest_passive(SPRING, PREMIUM, hands)
    assert 2.0 * VISCOUS_N_S_M / TICK_S <= stiffest < 600.0
    run = move(SPRING, PREMIUM, np.full(40, 3000.0), hands)
    assert run.gained_j.max() > 100.0 * GAIN_J


def test_the_energy_bounding_algorithm_gives_none_and_is_felt_as_what_damping_allows() -> None:
    hands = drawn_hands(40, 0)
    assert stiffest_passive(EBA, PREMIUM, hands) == TRIED_N_M[-1]
    assert rendered(EBA, PREMIUM, 5000.0) == pytest.approx(2.0 * VISCOUS_N_S_M / TICK_S, rel=0.15)


def test_an_observer_of_energy_lets_walls_be_stiffer_and_the_rigs_law_more_so() -> None:
    hands = drawn_hands(40, 0)
    spring, observer, rig = (stiffest_passive(law, PREMIUM, hands) for law in (SPRING, TDPA, RIG))
    assert spring < observer < rig
    assert rendered(RIG, PREMIUM, 1000.0) == pytest.approx(1000.0, rel=0.1)


def test_libraries_are_no_stiffer_than_they_say_the_arm_may_be() -> None:
    assert rendered(CHAI3D, "touch", 300.0) == pytest.approx(300.0, rel=0.1)
    assert rendered(CHAI3D, "touch", 900.0) < 460.0
    assert noticed(CHAI3D, "touch") > 0.5, "a wall of 500 N/m is one of 400 there"


def test_a_hand_that_is_too_fast_loses_the_force_of_openhaptics_until_it_has_left() -> None:
    file = arm_file(PREMIUM)
    law = LAWS[OPENHAPTICS](Walls(file, np.array([200.0]), TICK_S))
    deep = np.array([-2e-3])
    assert law.force(deep, np.zeros(1))[0] == pytest.approx(0.4)
    assert law.force(deep, np.array([-1.01 * file.max_velocity_m_s]))[0] == 0.0
    assert law.force(deep, np.zeros(1))[0] == 0.0
    assert law.force(np.array([1e-3]), np.zeros(1))[0] == 0.0
    assert law.force(deep, np.zeros(1))[0] == pytest.approx(0.4)


def test_a_wall_is_there_within_milliseconds_and_gone_when_it_is_left() -> None:
    for law in (RIG, SPRING):
        onset_ms, loss_ms = met_and_left(law, PREMIUM)
        # With a quarter of the friction to rely on, and a delay that may be, force begins a tick later.
        assert onset_ms <= (4.0 if law == RIG else 3.0)
        assert loss_ms <= 2.0
