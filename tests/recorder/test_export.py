"""Recordings as tables, arrays and films: the numbers are those recorded, and what is missing is one sentence."""

from __future__ import annotations

import builtins
import csv
from pathlib import Path

import av
import numpy as np
import pytest
from pyarrow import parquet

from trocar.review.commands.export import run_export
from trocar.review.export.film import write_film
from trocar.services.messages.extras import requirements_of
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import read_messages
from trocar.services.runtime.errors import ConfigError, MissingPackageError


@pytest.fixture(autouse=True)
def own_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """A film chooses how its process draws: what comes after it here draws as before."""
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def test_arrays_have_all_of_it_and_need_no_pickle(recorded: Path, tmp_path: Path) -> None:
    run_export(recorded, "npz", tmp_path / "a.npz", ())
    arrays = np.load(tmp_path / "a.npz", allow_pickle=False)
    states = [body for _, _, body in read_messages(recorded, ["physics.state"])]
    np.testing.assert_array_equal(arrays["physics.state.duct.q"], [state.duct.q.view() for state in states])
    np.testing.assert_array_equal(
        arrays["physics.state.tools.0.force_n"], [state.reactions()[0].force_n for state in states]
    )
    forces, first = (arrays[f"physics.state.contacts.force_n{part}"] for part in ("", ".first"))
    assert len(first) == len(states) + 1
    for n, state in enumerate(states):
        np.testing.assert_array_equal(forces[first[n] : first[n + 1]], state.contacts.force_n.view())


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_tables_have_a_column_for_each_number(recorded: Path, tmp_path: Path, to: str) -> None:
    run_export(recorded, to, tmp_path / "tables", ["gateway.state", "physics.state"])
    path = tmp_path / "tables" / f"gateway.state.{to}"
    if to == "csv":
        with path.open() as file:
            rows = list(csv.DictReader(file))
    else:
        rows = parquet.read_table(path).to_pylist()
    bodies = [body for _, _, body in read_messages(recorded, ["gateway.state"])]
    assert [int(row["tick"]) for row in rows] == [body.tick for body in bodies]
    assert [float(row["instruments.1.position_m.2"]) for row in rows] == [
        b.instruments[1].position_m[2] for b in bodies
    ]
    assert sorted(each.stem for each in path.parent.iterdir()) == ["gateway.state", "physics.state"]


@pytest.mark.parametrize("view", ["scope", "fluoroscopy"])
def test_a_film_lasts_as_long_as_the_recording(recorded: Path, tmp_path: Path, view: str) -> None:
    write_film(recorded, tmp_path / "a.mp4", view, rate_hz=2, size=(160, 120))
    times_ns = [time_ns for _, time_ns, _ in read_messages(recorded, ["gateway.state"])]
    with av.open(str(tmp_path / "a.mp4")) as film:
        images = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(images) == pytest.approx(2 * (times_ns[-1] - times_ns[0]) * 1e-9, abs=3.0)
    assert np.std(images[-1]) > 10.0, "there is something in the picture"
    is_grey = np.ptp(images[-1].astype(int), axis=2).max() < 12
    assert is_grey == (view == "fluoroscopy")


@pytest.mark.parametrize(("to", "package", "extra"), [("parquet", "pyarrow", "parquet"), ("mp4", "av", "video")])
def test_a_missing_package_is_one_sentence(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, to: str, package: str, extra: str
) -> None:
    real = builtins.__import__

    def lacking(name: str, *rest: object) -> object:
        if name.partition(".")[0] == package:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", lacking)
    with pytest.raises(
        MissingPackageError, match=rf"^{to} needs the package '{package}': .* -m pip install '{package}>="
    ) as told:
        run_export(recorded, to, tmp_path / "a", ())
    assert requirements_of(extra)[0] in str(told.value)  # no extra of a name that an index may not have


def test_a_topic_that_is_none_and_a_file_that_is_none_are_named(recorded: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no topic 'physics\.stat'; did you mean .*physics\.state"):
        run_export(recorded, "csv", tmp_path / "a", ["physics.stat"])
    (tmp_path / "b.mcap").write_text("no recording")
    with pytest.raises(RecordingError, match=r"b\.mcap: is not a recording"):
        run_export(tmp_path / "b.mcap", "csv", None, ())


@pytest.mark.parametrize("to", ["csv", "npz"])
def test_a_recording_that_is_not_there_leaves_no_folder(tmp_path, to):
    for _ in range(2):
        with pytest.raises(RecordingError, match="no such file"):
            run_export(tmp_path / "nofile", to, None, ())
    assert list(tmp_path.iterdir()) == []
