"""The Z-width of an arm: what each of its properties costs or gives, against theory."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.studies.feel.compare import TICK_S, TRIED_N_M, device_of, drawn_hands, stiffest_of
from trocar.studies.feel.laws import VISCOUS_N_S_M, Walls
from trocar.studies.feel.z_width import CASES, Damped, felt_shares, z_widths

PREMIUM = "phantom_premium_1_5"


def test_friction_gives_the_width_and_the_filter_takes_what_damping_would_give() -> None:
    found = {each.case: each for each in z_widths(40, arms=(PREMIUM,))}
    assert set(found) == set(CASES)
    whole = found["as it is"].stiffest_n_m
    assert all(np.greater_equal(found["exact encoder"].stiffest_n_m, whole))
    assert found["no dry friction"].stiffest_n_m[0] < found["no viscous friction"].stiffest_n_m[0] < whole[0]
    assert found["velocity not filtered"].stiffest_n_m[-1] > 1000.0 > whole[-1]
    assert found["as it is"].by_viscous_n_m == pytest.approx(2.0 * VISCOUS_N_S_M / TICK_S)
    assert found["as it is"].by_dry_n_m == pytest.approx(2.0 * 0.04 / 3e-5)


def test_an_arm_with_much_viscous_friction_and_no_other_is_passive_where_theory_says() -> None:
    """Colgate and Schenkel: b > K T / 2 + B, with any hand; of 40 hands the worst comes near it."""
    device, hands = CASES["no dry friction"](CASES["exact encoder"](device_of(PREMIUM))), drawn_hands(40, 0)
    viscous = 0.5
    border = 2.0 * viscous / TICK_S
    stiffest = stiffest_of(lambda walls: Damped(walls, 0.0), type(device)(device.file, device.mass_kg, viscous), hands)
    assert border * 0.8 <= stiffest < TRIED_N_M[-1]


def test_a_damper_pushes_only_where_the_wall_is() -> None:
    law = Damped(Walls(device_of(PREMIUM).file, np.array([100.0, 100.0])), 2.0)
    assert law.force(np.array([-1e-3, 1e-3]), np.array([-0.1, -0.1])).tolist() == pytest.approx([0.3, 0.0])
    assert law.force(np.array([-1e-3, -1e-3]), np.array([0.1, 0.0])).tolist() == pytest.approx([0.0, 0.1])


def test_a_fast_hand_feels_the_mass_of_the_arm() -> None:
    shares = felt_shares(PREMIUM, 500.0, (1.0, 5.0, 20.0))
    assert shares == pytest.approx([0.992, 0.803, -2.158], abs=1e-3)
