"""A csv file that is no recording is one sentence, which says the file and the place."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.gateway.recording import read_table
from services.runtime.errors import DeviceError

COLUMNS = ("time_s", "x_m")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "No such file or directory"),
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
    with pytest.raises(DeviceError, match=f"{file}: {sentence}") as caught:
        read_table(file, COLUMNS)
    assert "\n" not in str(caught.value)


def test_a_recording_is_read_by_its_columns(tmp_path: Path) -> None:
    file = tmp_path / "hand.csv"
    file.write_text("x_m,time_s\n0.5,0\n0.25,1\n")
    table = read_table(file, COLUMNS)
    assert (table["time_s"].tolist(), table["x_m"].tolist()) == ([0.0, 1.0], [0.5, 0.25])
