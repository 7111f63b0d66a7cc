"""A csv file that is no recording is one sentence, which says the file and the place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.made_samples import SUCCESS
from tests.recorder.conftest import recorded
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.devices.recording import read_hand, read_table
from trocar.services.gateway.servo import pose
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import read_messages
from trocar.services.runtime.config.rig import Mount
from trocar.services.runtime.errors import ConfigError

__all__ = ["recorded"]
COLUMNS = ("time_s", "x_m")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "no such file or directory"),
        ("", "the file is empty"),
        ("\n\n", "the file is empty"),
        ("time_s,x_m\n0,0\n1\n", r"is not a csv file with a header line: .*Line #3 \(got 1 columns instead of 2\)"),
        ("time,x\n0,0\n1,0\n", "there is no column time_s; there are time, x"),
        ("time_s,x_m\n", "needs two rows or more of finite numbers, has 0"),
        ("time_s,x_m\n0,0\n", "needs two rows or more of finite numbers, has 1"),
        ("time_s,x_m\n0,0\n1,far\n2,0\n", "row 2 below the header: x_m is not a finite number"),
        ("time_s,x_m\n0,0\n0,1\n", "time_s must increase"),
    ],
)
def test_what_is_no_recording_is_one_sentence(tmp_path: Path, text: str | None, sentence: str) -> None:
    file = tmp_path / "hand.csv"
    if text is not None:
        file.write_text(text)
    with pytest.raises(ConfigError if text is None else RecordingError, match=f"{file}: {sentence}") as caught:
        read_table(file, COLUMNS)
    assert "\n" not in str(caught.value)


def test_a_recording_is_read_by_its_columns(tmp_path: Path) -> None:
    file = tmp_path / "hand.csv"
    file.write_text("x_m,time_s\n0.5,0\n0.25,1\n")
    table = read_table(file, COLUMNS)
    assert (table["time_s"].tolist(), table["x_m"].tolist()) == ([0.0, 1.0], [0.5, 0.25])


def test_a_hand_is_read_from_a_recording_of_a_rig_wherever_the_arm_stands(recorded: Path) -> None:
    mount = Mount(centre_m=(0.01, 0.02, 0.03), yaw_rad=0.7)
    table = read_hand(recorded, COLUMNS, Place("1", mount))
    states = [body for _, _, body in read_messages(recorded, ["gateway.state"])]
    first_of_tick = {body.tick: body for body in reversed(states)}
    assert len(first_of_tick) < len(states), "time stood while the rig started: nothing ends there"
    hands = [first_of_tick[tick].instruments[1] for tick in sorted(first_of_tick)]
    packed, world_m = pose.pack_mount(mount), np.zeros(3)
    for row, hand in list(zip(table, hands, strict=True))[::100]:
        pose.to_world(np.array([row["x_m"], row["y_m"], row["z_m"]]), 0, packed, world_m, 0)
        np.testing.assert_allclose(world_m + packed[2:], hand.position_m, atol=1e-12)
        assert (row["roll_rad"], row["handle_angle_rad"]) == (hand.roll_rad, hand.handle_angle_rad)
    with pytest.raises(RecordingError, match=r"a\.mcap: holds no two frames of an instrument 'third'"):
        read_hand(recorded, COLUMNS, Place("third", mount))


def test_a_hand_of_a_sample_moves() -> None:
    table = read_hand(SUCCESS, COLUMNS, Place("left", Mount(centre_m=(0.0, 0.0, 0.0))))
    assert np.ptp(table["x_m"]) > 0.01
