from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trocar.services.gateway.motions.script import HIP, Breakpoint, Motion, Player, Script, read_player
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError

PORT = (0.06, -0.1, 0.13)


def _player(loop: bool = False, offset_m: float = 0.0, pace: float = 1.0) -> Player:
    points = (
        Breakpoint(time_s=0.0, hip_m=(0.0, 0.0, 0.0)),
        Breakpoint(time_s=2.0, hip_m=(0.1, 0.0, 0.0), handle_rad=0.2),
        Breakpoint(time_s=3.0, hip_m=(0.1, -0.1, 0.0)),
    )
    return Player(Motion(breakpoints=points, beyond_hip_m=offset_m), loop, PORT, pace)


def _sample(player: Player, time_s: float) -> tuple[np.ndarray, np.ndarray]:
    player.sample(time_s)
    return player.value.copy(), player.rate.copy()


def test_a_motion_passes_its_breakpoints_at_rest() -> None:
    player = _player()
    for time_s, x, y in ((0.0, 0.0, 0.0), (2.0, 0.1, 0.0), (3.0, 0.1, -0.1), (9.0, 0.1, -0.1)):
        value, rate = _sample(player, time_s)
        np.testing.assert_allclose(value[HIP : HIP + 2], (x, y), atol=1e-12)
        np.testing.assert_allclose(rate, 0.0, atol=1e-12)


def test_peak_speed_is_that_of_minimum_jerk() -> None:
    _, rate = _sample(_player(), 1.0)
    assert rate[HIP] == pytest.approx(1.875 * 0.1 / 2.0)


def test_rate_is_the_derivative() -> None:
    player, h = _player(), 1e-6
    difference = (_sample(player, 0.7 + h)[0] - _sample(player, 0.7 - h)[0]) / (2 * h)
    np.testing.assert_allclose(_sample(player, 0.7)[1], difference, atol=1e-8)


def test_breakpoints_may_be_for_the_tip() -> None:
    offset_m, h = 0.015, 1e-6
    tip = _sample(_player(), 0.7)[0][HIP : HIP + 3]
    junction, rate = _sample(_player(offset_m=offset_m), 0.7)
    assert np.linalg.norm(tip - junction[:3]) == pytest.approx(offset_m)
    shaft, jaws = tip - PORT, tip - junction[:3]
    np.testing.assert_allclose(jaws / offset_m, shaft / np.linalg.norm(shaft), atol=1e-12)
    player = _player(offset_m=offset_m)
    difference = (_sample(player, 0.7 + h)[0] - _sample(player, 0.7 - h)[0]) / (2 * h)
    np.testing.assert_allclose(rate, difference, atol=1e-8)


@pytest.mark.parametrize("pace", [0.25, 2.0])
def test_the_same_motion_at_another_pace(pace: float) -> None:
    value, rate = _sample(_player(offset_m=0.015), 0.7)
    paced_value, paced_rate = _sample(_player(offset_m=0.015, pace=pace), 0.7 / pace)
    np.testing.assert_allclose(paced_value, value, rtol=1e-12)
    np.testing.assert_allclose(paced_rate, pace * rate, rtol=1e-12)


def test_a_loop_begins_again() -> None:
    player = _player(loop=True)
    np.testing.assert_allclose(_sample(player, 3.7)[0], _sample(player, 0.7)[0])


def test_an_instrument_without_a_motion_is_named() -> None:
    with pytest.raises(ConfigError, match=r"stroke\.yaml.*'third'.*left, right"):
        read_player("stroke", "third", PORT)


def test_breakpoints_out_of_order_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text("motions: {left: {breakpoints: [{time_s: 1, hip_m: [0, 0, 0]}, {time_s: 0.5, hip_m: [0, 0, 0]}]}}")
    with pytest.raises(ConfigError, match=r"bad\.yaml: motions\.left: breakpoints must be in the order"):
        read_player(str(path), "left", PORT)


@pytest.mark.parametrize("path", sorted((config.config_directory() / "scripts").glob("*.yaml")), ids=lambda p: p.stem)
def test_every_script_loads_and_moves_no_faster_than_a_hand(path: Path) -> None:
    script = config.load(Script, path)[0]
    for motion in script.motions.values():
        player = Player(motion, loop=False, port_m=PORT)
        for time_s in np.arange(0.0, motion.breakpoints[-1].time_s, 0.05):
            assert np.linalg.norm(_sample(player, float(time_s))[1][HIP : HIP + 3]) < 0.3
