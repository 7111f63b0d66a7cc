from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from services.gateway import hand_motion
from services.runtime.errors import DeviceError

GRASP = Path(__file__).resolve().parents[3] / "shared" / "data" / "grasp"


def test_a_recording_is_played_there_and_back_without_a_jump(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    path.write_text("time_s,handle_angle_rad\n0,0.0\n0.001,0.1\n0.002,0.2\n")
    wanted = hand_motion.recorded(path)
    angles = [wanted((k + 0.5) * 1e-3) for k in range(6)]
    assert angles == pytest.approx([0.0, 0.1, 0.2, 0.1, 0.0, 0.1])


@pytest.mark.parametrize(
    "text", ["time_s\n1\n2\n", "handle_angle_rad\nnan\n0\n", "", "time_s,handle_angle_rad\n1,2\n1,2\n"]
)
def test_a_file_that_is_no_recording_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(DeviceError, match=r"bad\.csv: "):
        hand_motion.recorded(path)


@pytest.mark.parametrize("path", sorted(GRASP.glob("*.csv")) or [None], ids=lambda path: path.stem if path else "none")
def test_real_recordings_move_a_handle_as_a_hand_does(path: Path | None) -> None:
    if path is None:
        pytest.skip(f"there are no recordings in {GRASP}")
    wanted = hand_motion.recorded(path)
    angles = np.array([wanted(k * 1e-3) for k in range(45_000)])  # 20 s there, 20 s back, and on
    assert 0.0 <= angles.min() < 0.1
    assert 1.0 < angles.max() < 1.1
    assert np.abs(np.diff(angles)).max() < 0.005


def test_scripts_and_scenarios_move_a_handle() -> None:
    assert hand_motion.scripted("stroke", "left")(0.0) == 1.0
    assert hand_motion.of_scenario("insertion", 0)(10.0) == pytest.approx(0.25)
    assert hand_motion.of_scenario("insertion", 0, 0.25)(1.6) == hand_motion.of_scenario("insertion", 0)(0.4)
    assert 0.1 <= min(hand_motion.squeeze(k * 0.1) for k in range(40)) < 0.11


def test_a_motion_fits_between_two_angles() -> None:
    wanted = hand_motion.fitted(lambda time_s: time_s, (0.7, 1.2))
    assert [wanted(t) for t in (-1.0, 0.0, 0.5, 1.0, 1.06)] == [0.7, 0.7, 0.95, 1.2, 1.2]
