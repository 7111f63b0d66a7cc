"""HandMotions as a table: every edit touches what it says, and nothing else."""

import numpy as np
import pytest

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.studies.stability.hands import least_jerk, still
from trocar.studies.stability.strokes import at_step

HERE = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])


def test_after_the_last_row_nobody_is_there():
    hands, tools = still(HERE, (0.1, 0.2), 3), ToolInputs()
    hands.write(2, tools)
    assert tools.present.all()
    np.testing.assert_array_equal(tools.position_m, HERE)
    hands.write(3, tools)
    assert not tools.present.any()


def test_a_tool_that_is_moved_stays_where_it_ends_and_the_other_one_stays():
    hands = still(HERE, (0.1, 0.2), 6).moved(1, np.array([[0.1, 0.0, 0.0], [0.3, 0.0, 0.0]]), 2)
    np.testing.assert_allclose(hands.position_m[:, 1, 0], [4.0, 4.0, 4.1, 4.3, 4.3, 4.3])
    np.testing.assert_array_equal(hands.position_m[:, 0], np.tile(HERE[0], (6, 1)))


def test_a_tool_that_rolls_stays_so_and_the_other_one_does_not_roll():
    hands = still(HERE, (0.1, 0.2), 5)
    rolled = hands.rolled(1, np.array([0.1, 0.3]), 2).roll_rad - hands.roll_rad
    np.testing.assert_allclose(rolled[:, 1], [0.0, 0.0, 0.1, 0.3, 0.3])
    assert not rolled[:, 0].any()


def test_the_top_speed_is_that_of_a_tool_that_is_there():
    hands = still(HERE, (0.1, 0.2), 6).moved(0, np.array([[0.5, 0.0, 0.0]]), 3)
    assert hands.top_speed_m_s(0.1) == pytest.approx(5.0)
    away = np.zeros(6, np.bool_)
    away[3] = True
    assert hands.without(0, away).top_speed_m_s(0.1) == 0.0


def test_least_jerk_ends_where_it_shall_at_the_speed_asked_for():
    way = least_jerk(20e-3, np.array([0.0, 0.0, -1.0]), 0.5)
    np.testing.assert_allclose(way[-1], [0.0, 0.0, -20e-3], atol=1e-15)
    assert np.abs(np.diff(way[:, 2], prepend=0.0)).max() / 1e-3 == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("dt_s", [1e-4, 5e-3])
def test_another_step_takes_as_long(dt_s):
    hands = still(HERE, (0.1, 0.2), 100).moved(0, np.outer(np.arange(100), [1.0, 0.0, 0.0]), 0)
    other = at_step(hands, dt_s)
    assert len(other) * dt_s == pytest.approx(0.1)
    assert other.position_m[-1, 0, 0] == pytest.approx(100.0, abs=6.0)


def test_hands_go_straight_between_their_rows():
    hands = still(HERE, (0.1, 0.2), 5).moved(0, np.outer(np.arange(5), [1.0, 0.0, 0.0]), 0)
    hands = hands.with_jaws(1, np.array([0.2, 0.4]), 1)
    finer = at_step(hands, 0.25e-3)
    np.testing.assert_allclose(finer.position_m[:17, 0, 0], 1.0 + 0.25 * np.arange(17))
    assert finer.jaw_angle_rad[6, 1] == pytest.approx(0.3)
    np.testing.assert_array_equal(at_step(hands, 1e-3).position_m, hands.position_m)
    np.testing.assert_array_equal(at_step(hands, 2e-3).position_m, hands.position_m[::2])
