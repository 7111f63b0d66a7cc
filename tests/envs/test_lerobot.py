"""Demonstrations as a LeRobot dataset: it holds what cloning learns from, and LeRobot's own package opens it."""

from __future__ import annotations

import json
import os
import re
import subprocess
import weakref
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from pyarrow import parquet

from tests.envs.walks import SMALL
from trocar.envs import lerobot
from trocar.envs.cloning import read_demonstrations
from trocar.envs.demonstrations import read_attempts
from trocar.envs.lerobot import CHUNK, _ImageShades, export_dataset
from trocar.envs.rollouts import rollouts
from trocar.protocol import Frame
from trocar.review.commands.verbs import Form, export
from trocar.review.export import film
from trocar.services.recordings.errors import RecordingError
from trocar.services.runtime.errors import ConfigError, UserError

#: An environment with LeRobot's package, as docs/how-to/environments.md says how to make it: it takes 6 GB.
LEROBOT = Path(__file__).resolve().parents[2] / "build" / "lerobot" / "bin" / "python"
JUDGE = Path(__file__).with_name("opened_by_lerobot.py")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("demonstrations")
    list(rollouts(None, range(2), noise=0.1, record=str(folder), overrides=SMALL))
    return sorted(folder.glob("*.mcap"))


def columns(folder: Path) -> dict[str, np.ndarray]:
    table = parquet.read_table(folder / "data" / "chunk-000" / "file-000.parquet")
    return {name: np.array(table[name].to_pylist()) for name in table.column_names}


def info(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "meta" / "info.json").read_text())
    return found


def test_it_holds_to_the_bit_what_cloning_reads_of_the_recordings(recordings: list[Path], tmp_path: Path) -> None:
    said = export_dataset(recordings, tmp_path / "set", fps=50)
    observations, actions = read_demonstrations(recordings)
    held = columns(tmp_path / "set")
    np.testing.assert_array_equal(held["observation.state"], observations)
    np.testing.assert_array_equal(held["action"], actions.reshape(len(actions), -1).astype(np.float32))
    assert f"2 episodes, {len(actions)} moments at 50 a second" in said
    done = np.flatnonzero(held["next.done"])
    np.testing.assert_array_equal(held["next.success"][done], [True, True])
    np.testing.assert_array_equal(held["episode_index"][done], [0, 1])
    np.testing.assert_array_equal(held["index"], np.arange(len(actions)))
    np.testing.assert_allclose(held["timestamp"], held["frame_index"] / 50, atol=1e-5)


def test_what_it_says_of_itself_agrees_with_what_it_holds(recordings: list[Path], tmp_path: Path) -> None:
    export_dataset(recordings, tmp_path / "set", fps=50, task="Insert it")
    held, said = columns(tmp_path / "set"), info(tmp_path / "set")
    assert (said["total_episodes"], said["total_frames"], said["total_tasks"]) == (2, len(held["index"]), 1)
    for name, feature in said["features"].items():
        assert np.prod(held[name].shape[1:], dtype=int) == np.prod(feature["shape"]), name
        assert feature["names"] is None or len(feature["names"]) == feature["shape"][0]
    stats = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())
    np.testing.assert_allclose(stats["action"]["mean"], held["action"].mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(stats["action"]["q90"], np.quantile(held["action"], 0.9, axis=0), atol=1e-6)
    assert stats["action"]["count"] == [len(held["index"])]
    episodes = parquet.read_table(next((tmp_path / "set" / "meta" / "episodes").rglob("*.parquet"))).to_pylist()
    assert [row["dataset_from_index"] for row in episodes] == [0, episodes[0]["length"]]
    assert episodes[1]["dataset_to_index"] == len(held["index"])
    assert episodes[0]["tasks"] == ["Insert it"]


def test_its_film_has_a_picture_for_each_moment(recordings: list[Path], tmp_path: Path) -> None:
    export_dataset(recordings[:1], tmp_path / "set", fps=10, view="scope")
    films = list((tmp_path / "set" / "videos").rglob("*.mp4"))
    assert [str(film.relative_to(tmp_path / "set")) for film in films] == [
        "videos/observation.images.scope/chunk-000/file-000.mp4"
    ]
    with av.open(str(films[0])) as film:
        times_s = [float(picture.pts * picture.time_base) for picture in film.decode(video=0)]
    np.testing.assert_allclose(times_s, columns(tmp_path / "set")["timestamp"], atol=1e-3)
    feature = info(tmp_path / "set")["features"]["observation.images.scope"]
    assert (feature["dtype"], feature["shape"], feature["info"]["video.fps"]) == ("video", [480, 640, 3], 10)


def test_statistics_of_pictures_are_those_of_all_their_values() -> None:
    random = np.random.default_rng(3)
    images = [random.integers(low, low + 90, (7, 5, 3), np.uint8) for low in (0, 0, 40, 165)]
    parts = [_ImageShades() for _ in range(2)]
    parts[0].add(images[0])
    for image in images[1:]:
        parts[1].add(image)
    parts[0].add_all(parts[1])
    found, values = parts[0].stats(), np.stack(images).reshape(-1, 3) / 255.0
    for name, wanted in {
        "min": values.min(axis=0), "max": values.max(axis=0), "mean": values.mean(axis=0), "std": values.std(axis=0),
        "q01": np.quantile(values, 0.01, axis=0), "q50": np.quantile(values, 0.5, axis=0),
        "q90": np.quantile(values, 0.9, axis=0),
    }.items():  # fmt: skip
        np.testing.assert_allclose(found[name], wanted.reshape(3, 1, 1), atol=1e-12, err_msg=name)
    np.testing.assert_array_equal(found["count"], [4])


def noise(tick: int) -> np.ndarray:
    """Return a picture that no other time has."""
    return np.random.default_rng(tick).integers(tick % 100, tick % 100 + 100, (48, 64, 3), np.uint8)


class CountingCamera:
    """Draws noise, and counts its pictures that are still in memory."""

    alive = most = drawn = 0

    def image(self, frames: dict[str, Frame]) -> np.ndarray:
        image = noise(frames["physics.state"].body.tick)
        self.alive, self.drawn = self.alive + 1, self.drawn + 1
        self.most = max(self.most, self.alive)
        weakref.finalize(image, self.forget_picture)
        return image

    def forget_picture(self) -> None:
        self.alive -= 1

    def close(self) -> None:
        """Nothing is open."""


def test_pictures_are_written_as_they_are_drawn_and_are_those_of_their_moments(
    recordings: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = CountingCamera()
    monkeypatch.setattr(film, "recorded_camera", lambda *_: camera)
    monkeypatch.setattr(lerobot, "_SAMPLED_IMAGES", 10)
    export_dataset(recordings, tmp_path / "set", fps=10, view="scope")
    assert camera.drawn == len(columns(tmp_path / "set")["index"]) > 60
    assert camera.most <= 2, "one is drawn while the last is being encoded"
    sampled = [
        noise(tick)
        for (shown,) in (read_attempts(file, 10) for file in recordings)
        for tick in shown.ticks[: -1 : (len(shown.ticks) - 1) // 10]
    ]
    values = np.stack(sampled).reshape(-1, 3) / 255.0
    stats = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())["observation.images.scope"]
    for name, wanted in {
        "mean": values.mean(axis=0), "std": values.std(axis=0), "q99": np.quantile(values, 0.99, axis=0),
    }.items():  # fmt: skip
        np.testing.assert_allclose(np.ravel(stats[name]), wanted, atol=1e-12, err_msg=name)
    assert stats["count"] == [len(sampled)]


def damaged(recording: Path, folder: Path) -> Path:
    """Return a recording whose middle was lost."""
    data, place = recording.read_bytes(), folder / "damaged.mcap"
    place.write_bytes(data[: len(data) // 3] + bytes(len(data) // 3) + data[2 * (len(data) // 3) :])
    return place


@pytest.mark.parametrize("is_missing", [False, True])
def test_of_a_set_that_fails_in_the_middle_nothing_stays(
    recordings: list[Path], tmp_path: Path, is_missing: bool
) -> None:
    wrong = tmp_path / "none.mcap" if is_missing else damaged(recordings[1], tmp_path)
    (tmp_path / "out").mkdir()
    with pytest.raises(UserError, match=re.escape(str(wrong))):
        export_dataset([recordings[0], wrong], tmp_path / "out" / "set", fps=50)
    assert list((tmp_path / "out").iterdir()) == []
    export_dataset(recordings[:1], tmp_path / "out" / "set", fps=50)
    assert [each.name for each in (tmp_path / "out").iterdir()] == ["set"]


@pytest.mark.parametrize("fps", [7, 30, 33])
def test_a_rate_that_does_not_divide_the_recordings_is_held_on_the_average(
    recordings: list[Path], tmp_path: Path, fps: int
) -> None:
    export_dataset(recordings, tmp_path / "set", fps=fps, task="Führe ein – 挿入 🩺")
    usual = export_dataset(recordings, tmp_path / "usual", fps=50)
    held, every = columns(tmp_path / "set"), columns(tmp_path / "usual")
    assert "2 episodes" in usual
    assert len(held["index"]) == pytest.approx(len(every["index"]) * fps / 50, abs=4)
    assert parquet.read_table(tmp_path / "set" / "meta" / "tasks.parquet").to_pylist()[0] == {
        "task_index": 0,
        "__index_level_0__": "Führe ein – 挿入 🩺",
    }


@pytest.mark.parametrize(
    ("options", "said"),
    [({"fps": 0}, "fps: must be a whole number"), ({"fps": 2.5}, "fps: must be"), ({"task": "a\udcff"}, "task: 'a")],
)
def test_an_argument_that_is_none_is_a_sentence(
    recordings: list[Path], tmp_path: Path, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(ConfigError, match=said):
        export_dataset(recordings, tmp_path / "set", **{"fps": 50} | options)


def test_the_older_layout_has_a_file_for_each_episode(recordings: list[Path], tmp_path: Path) -> None:
    export_dataset(recordings, tmp_path / "set", fps=50, layout="v2.1")
    said = info(tmp_path / "set")
    lengths = []
    for number in range(2):
        path = said["data_path"].format(episode_chunk=number // CHUNK, episode_index=number)
        lengths.append(parquet.read_table(tmp_path / "set" / path).num_rows)
    rows = [json.loads(line) for line in (tmp_path / "set" / "meta" / "episodes.jsonl").read_text().splitlines()]
    assert [row["length"] for row in rows] == lengths
    assert len((tmp_path / "set" / "meta" / "episodes_stats.jsonl").read_text().splitlines()) == 2


def test_what_cannot_be_one_is_a_sentence(recordings: list[Path], tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="has 50 moments a second, fewer than the 200 asked for"):
        export_dataset(recordings[:1], tmp_path / "fast", fps=200)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").touch()
    with pytest.raises(ConfigError, match="full: is there already"):
        export_dataset(recordings[:1], tmp_path / "full", fps=50)
    with pytest.raises(ConfigError, match="--to csv: takes one recording at a time, and 2 are named"):
        export(recordings, Form.CSV)


@pytest.mark.long
@pytest.mark.skipif(not LEROBOT.exists(), reason=f"no LeRobot: it is to be installed in {LEROBOT.parents[1]}")
@pytest.mark.parametrize("layout_has_film", [False, True])
def test_lerobot_itself_opens_it_and_finds_its_statistics(
    recordings: list[Path], tmp_path: Path, layout_has_film: bool
) -> None:
    export_dataset(recordings, tmp_path / "set", fps=25, view="scope" if layout_has_film else None)
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "PYTHONPATH": ""}
    asked = [str(LEROBOT), str(JUDGE), str(tmp_path / "set")]
    told = subprocess.run(asked, env=environment, capture_output=True, text=True, timeout=500, check=True).stdout
    found = json.loads(told.splitlines()[-1])
    held = columns(tmp_path / "set")
    assert (found["length"], found["episodes"], found["fps"]) == (len(held["index"]), 2, 25)
    np.testing.assert_allclose(found["action"], held["action"][10], atol=1e-6)
    assert found["image"] == ([3, 480, 640] if layout_has_film else None)
    assert found["worst_statistic"] < 1e-6
