from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trocar.services.gateway.simulated import hand_motion
from trocar.services.recordings.errors import RecordingError

GRASP = Path(__file__).resolve().parents[4] / "shared" / "data" / "grasp"


def test_a_recording_is_played_there_and_back_without_a_jump(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    path.write_text("time_s,handle_angle_rad\n0,0.0\n0.001,0.1\n0.002,0.2\n")
    motion = hand_motion.recorded(path)
    assert motion.angle_rad == pytest.approx([0.0, 0.1, 0.2, 0.1])
    assert motion.repeats


@pytest.mark.parametrize(
    "text", ["time_s\n1\n2\n", "handle_angle_rad\nnan\n0\n", "", "time_s,handle_angle_rad\n1,2\n1,2\n"]
)
def test_a_file_that_is_no_recording_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(RecordingError, match=r"bad\.csv: "):
        hand_motion.recorded(path)


@pytest.mark.parametrize("path", sorted(GRASP.glob("*.csv")) or [None], ids=lambda path: path.stem if path else "none")
def test_real_recordings_move_a_handle_as_a_hand_does(path: Path | None) -> None:
    if path is None:
        pytest.skip(f"there are no recordings in {GRASP}")
    angles = hand_motion.recorded(path).angle_rad  # 20 s there, 20 s back
    assert 0.0 <= angles.min() < 0.1
    assert 1.0 < angles.max() < 1.1
    assert np.abs(np.diff(angles, append=angles[0])).max() < 0.005


def test_scripts_repeat_and_scenarios_end() -> None:
    stroke, insertion = hand_motion.scripted("stroke", "left"), hand_motion.of_scenario("insertion", 0)
    assert stroke.repeats
    assert stroke.angle_rad[0] == 1.0
    assert not insertion.repeats
    assert insertion.angle_rad[-1] == pytest.approx(0.25)


def test_at_a_quarter_of_the_pace_it_is_the_same_motion_four_times_as_long() -> None:
    usual, slow = hand_motion.of_scenario("insertion", 0), hand_motion.of_scenario("insertion", 0, 0.25)
    np.testing.assert_allclose(slow.angle_rad[::4], usual.angle_rad, atol=1e-12)


def test_a_squeeze_is_between_nearly_shut_and_open_without_a_jump() -> None:
    angles = hand_motion.squeeze().angle_rad
    assert (angles.min(), angles.max()) == pytest.approx((0.1, 1.0))
    assert np.abs(np.diff(angles, append=angles[0])).max() < 1e-3


def test_a_motion_fits_between_two_angles() -> None:
    motion = hand_motion.HandMotion(np.array([-1.0, 0.0, 0.5, 1.0, 1.06]), repeats=False)
    np.testing.assert_allclose(hand_motion.fitted(motion, (0.7, 1.2)).angle_rad, [0.7, 0.7, 0.95, 1.2, 1.2])
