"""A tool is swept to its target: at a bounded speed, about its port, and exactly there in the end."""

import math

import numpy as np
import pytest

from trocar.services.mechanics.bodies.forceps.sweep import FASTEST_HAND_M_S, LONGEST_SHAFT_M, sweep
from trocar.services.mechanics.bodies.forceps.tool_body import LONGEST_UNSOUND_S, ToolBody
from trocar.services.mechanics.scene import ForcepsScene
from trocar.services.mechanics.scene.tools import ToolInputs

PORT_M = np.array([0.02, -0.03, 0.12])
JAW_M, REACH_M = 15e-3, 0.5e-3


def swept(start, roll, target, asked_roll, reach_m=REACH_M):
    """Poses (J, opening, roll) on the way until the target is reached."""
    poses = [np.append(start, roll)]
    while len(poses) < 2000 and not np.array_equal(poses[-1], np.append(target, asked_roll)):
        out, now = np.empty(4), poses[-1]
        turned = sweep(PORT_M, (now[:4].copy(), now[4]), (target[:3], target[3], asked_roll), (JAW_M, reach_m), out)
        poses.append(np.append(out, turned))
    return np.array(poses)


@pytest.mark.parametrize(
    "target",
    [(0.07, -0.02, 0.01, 0.9), (0.02, 0.05, 0.2, 0.0), (0.02, -0.03, 0.2299, 0.4), (0.02, -0.03, 0.23, 0.4)],
    ids=["across", "above the port", "almost through the port", "straight through the port"],
)
def test_no_step_is_longer_than_its_reach_and_the_target_is_met_exactly(target):
    start = np.array([0.02, -0.03, 0.01, 0.2])
    poses = swept(start, 0.0, np.array(target), 3.0)
    way_m = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    assert way_m.max() <= REACH_M * (1.0 + 1e-9)
    assert JAW_M * (np.abs(np.diff(poses[:, 4])) + 0.5 * np.abs(np.diff(poses[:, 3]))).max() <= REACH_M * (1.0 + 1e-9)
    np.testing.assert_array_equal(poses[-1], [*target, 3.0])


def test_the_way_of_the_junction_is_a_swing_of_even_speed_about_the_port():
    """From 0.1 m straight down to 0.1 m sideways: a quarter of a circle."""
    down, aside = PORT_M - np.array([0.0, 0.0, 0.1]), PORT_M + np.array([0.1, 0.0, 0.0])
    poses = swept(np.append(down, 0.0), 0.0, np.append(aside, 0.0), 0.0)
    np.testing.assert_allclose(np.linalg.norm(poses[:, :3] - PORT_M, axis=1), 0.1, rtol=1e-9)
    assert len(poses) - 1 == math.ceil(0.05 * math.pi / REACH_M)


def test_what_is_within_reach_is_reached_bit_for_bit():
    start, target = np.array([0.02, -0.03, 0.01, 0.2]), np.array([0.0203, -0.0301, 0.0102, 0.21])
    assert len(swept(start, 0.1, target, 0.11)) == 2


def test_a_tool_follows_a_jump_at_the_speed_of_a_hand_and_appears_where_it_is():
    tools, inputs = ToolBody((ForcepsScene(), ForcepsScene())), ToolInputs()
    tools.predict(inputs, 1e-3)
    np.testing.assert_array_equal(tools.hand[0, :3], inputs.position_m[0])
    inputs.position_m[0] = 0.0, 0.04, 0.01
    tools.predict(inputs, 1e-3)
    assert np.linalg.norm(tools.hand[0, :3]) == pytest.approx(FASTEST_HAND_M_S * 1e-3, rel=0.2)
    inputs.present[0] = False
    tools.predict(inputs, 1e-3)
    inputs.present[0] = True
    tools.predict(inputs, 1e-3)
    np.testing.assert_array_equal(tools.hand[0, :3], inputs.position_m[0])


@pytest.mark.parametrize("spoil", [(0, 1.0), (1, -50.0), (2, 1e30)])
def test_a_junction_that_no_shaft_reaches_is_refused(spoil):
    tools, inputs = ToolBody((ForcepsScene(), ForcepsScene())), ToolInputs()
    tools.predict(inputs, 1e-3)
    inputs.position_m[0, spoil[0]] = spoil[1]
    assert np.linalg.norm(inputs.position_m[0] - tools.port_m[0]) > LONGEST_SHAFT_M
    tools.predict(inputs, 1e-3)
    assert tools.refused == 1
    tools.predict(inputs, 1.1 * LONGEST_UNSOUND_S)
    assert list(tools.present) == [False, True]


def test_it_is_said_while_a_tool_is_behind_its_hand():
    tools, inputs = ToolBody((ForcepsScene(), ForcepsScene())), ToolInputs()
    behind = []
    for jump_m in (0.0, 1.2e-3, 0.0, 0.0, 0.0):
        inputs.position_m[1, 2] += jump_m
        tools.predict(inputs, 1e-3)
        behind.append(tools.is_lagging)
    assert behind == [False, True, True, False, False]
