"""Demonstrations as a dataset of LeRobot: ``trocar export --to lerobot``.

The layout is that of https://github.com/huggingface/lerobot, in versions 3.0 and 2.1. Features are `observation.state`
(`trocar.envs.state.FIELDS`), `observation.forces`, `action` (what an environment takes), `next.done`, `next.success`,
and with a film `observation.images.<view>`.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trocar.envs.demonstrations import (
    Demonstration,
    action_names,
    draw_moments,
    force_names,
    read_attempts,
    state_names,
)
from trocar.review.export.pictures import film_info, write_pictures
from trocar.services.files.atomic_file import atomic_folder
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.runtime.errors import ConfigError, MissingPackageError

Values = npt.NDArray[Any]
Stats = dict[str, dict[str, Any]]
LAYOUTS = ("v3.0", "v2.1")
#: As LeRobot has them: files in a folder, and the sizes beyond which another file begins.
CHUNK, DATA_MB, VIDEO_MB = 1000, 100, 200
_QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
#: Width and height of a film, as learners of robots have them.
_IMAGE_SIZE = 640, 480
#: So many pictures of an episode are enough for the statistics of a film; a colour has so many shades.
_SAMPLED_IMAGES, _SHADES = 100, 256
_EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_PATHS = {
    "v3.0": (
        "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    ),
    "v2.1": (
        "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    ),
}


def export_dataset(
    files: Sequence[Path], folder: Path, *, fps: int, view: str | None = None, task: str = "", layout: str = LAYOUTS[0]
) -> str:
    """Write the attempts of recordings as one dataset, and return a sentence that says how much it holds.

    The folder is there once all is written; of one that fails, as by a damaged recording, nothing stays.

    Args:
        files: Recordings.
        folder: A folder that is not there yet, or is empty.
        fps: Moments a second.
        view: The camera of a film; None for no film.
        task: What was to be done, in words; empty: as the scenario calls it.
        layout: One of `LAYOUTS`.

    Raises ConfigError if there is something in the folder, no attempt in the recordings, or an argument is invalid;
    RecordingError if one cannot be read, MissingPackageError if a package is not installed.
    """
    if type(fps) is not int or fps < 1:
        raise ConfigError(f"fps: must be a whole number from 1 on, is {fps!r}")
    if not task.isprintable():  # a part of an argument that is no UTF-8 is not, either
        raise ConfigError(f"task: {task!a} is not one line of text")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder}: is there already")
    for package in ("pyarrow", "av") if view else ("pyarrow",):
        try:
            __import__(package)
        except ModuleNotFoundError:
            raise MissingPackageError("lerobot", package) from None
    with atomic_folder(folder) as half:
        dataset = Dataset(half, fps, view, layout)
        for file in files:
            found = list(read_attempts(file, fps))
            with closing(_pictures(file, found, view)) as pictures:
                for shown in found:
                    dataset.add_episode(shown, task or shown.task or "practise", pictures)
        if not dataset.lengths:
            raise ConfigError(f"{', '.join(map(str, files))}: no attempt is in it")
        dataset.close()
    return f"{folder}: {len(dataset.lengths)} episodes, {sum(dataset.lengths)} moments at {fps} a second"


def _pictures(file: Path, attempts: Sequence[Demonstration], view: str | None) -> Generator[Values, None, None]:
    """Yield the picture of each moment of the attempts that is followed by another; without a view none."""
    places = [place for shown in attempts for place in shown.places[:-1]]
    if view and places:
        from trocar.review.export.film import recorded_camera  # a verb's: its import changes the process

        with closing(recorded_camera(file, view, _IMAGE_SIZE)) as camera:
            yield from draw_moments(file, places, camera)


def read_dataset(folder: Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return observations (n, s) and actions (n, tools, 5) of a dataset of version 3.0 made by `export_dataset`.

    They are what `trocar.envs.cloning.read_demonstrations` returns of the recordings, actions rounded to single
    precision.

    Raises ConfigError if the folder holds no such dataset, MissingPackageError if a package is not installed.
    """
    try:
        from pyarrow import parquet
    except ModuleNotFoundError:
        raise MissingPackageError("lerobot", "pyarrow") from None
    files = sorted((folder / "data").glob("chunk-*/file-*.parquet"))
    if not files:
        raise ConfigError(f"{folder}: holds no dataset of LeRobot 3.0")
    columns = "observation.state", "action"
    try:
        tables = [parquet.read_table(file, columns=list(columns)) for file in files]
        states, actions = (
            np.concatenate([np.array(table[name].to_pylist(), np.float64) for table in tables]) for name in columns
        )
        return states, actions.reshape(len(actions), N_TOOLS, -1)
    except (OSError, ValueError, KeyError) as error:
        raise ConfigError(f"{folder}: is no dataset of an insertion: {error}") from None


class Dataset:
    """A dataset that is being written; nothing is in its folder before the first episode.

    Attributes:
        lengths: Moments of each episode so far.
    """

    def __init__(self, folder: Path, fps: int, view: str | None, layout: str) -> None:
        self.lengths: list[int] = []
        self._folder, self._fps, self._layout = folder, fps, layout
        self._film = f"observation.images.{view}" if view else ""
        self._data_path, self._video_path = _PATHS[layout]
        self._tasks: list[str] = []
        self._episodes: list[dict[str, Any]] = []
        self._all: dict[str, list[Values]] = {}
        self._shades = _ImageShades()
        self._pending: list[Any] = []
        self._data_file = 0

    def add_episode(self, shown: Demonstration, task: str, pictures: Iterator[Values]) -> None:
        """Append an attempt, and with a film the next of the pictures, each as it comes."""
        if task not in self._tasks:
            self._tasks.append(task)
        columns = self._columns(shown, self._tasks.index(task))
        length, number, begins = len(columns["index"]), len(self.lengths), sum(self.lengths)
        stats = {name: _stats(values) for name, values in columns.items()}
        row: dict[str, Any] = {"episode_index": number, "tasks": [task], "length": length}
        row |= {**self._write_data(columns, number), "dataset_from_index": begins, "dataset_to_index": begins + length}
        for name, values in columns.items():
            self._all.setdefault(name, []).append(values)
        if self._film:
            shades = _ImageShades()
            film = shades.take_some(islice(pictures, length), max(1, length // _SAMPLED_IMAGES))
            write_pictures(self._path(self._video_path, number, video_key=self._film), film, self._fps)
            place = {"chunk_index": number // CHUNK, "file_index": number % CHUNK}
            times = {"from_timestamp": 0.0, "to_timestamp": length / self._fps}
            row |= {f"videos/{self._film}/{name}": value for name, value in {**place, **times}.items()}
            stats[self._film] = shades.stats()
            self._shades.add_all(shades)
        self._episodes.append({**row, "stats": stats})
        self.lengths.append(length)

    def close(self) -> None:
        """Write what is pending, and what the dataset says of itself."""
        self._flush_data()
        all_stats = {name: _stats(np.concatenate(parts)) for name, parts in self._all.items()}
        if self._shades.count:
            all_stats[self._film] = self._shades.stats()
        if self._layout == "v3.0":
            self._write_meta_3(all_stats)
        else:
            self._write_meta_2()
        self._write_text("meta/info.json", json.dumps(self._info(), indent=4))

    def _columns(self, shown: Demonstration, task: int) -> dict[str, Values]:
        actions = shown.actions()
        n = len(actions)
        frame = np.arange(n, dtype=np.int64)
        done = frame == n - 1
        return {
            "observation.state": np.stack(shown.states[:n]).astype(np.float32),
            "observation.forces": np.array(shown.forces[:n], np.float32),
            "action": actions,
            "next.done": done,
            "next.success": done & (shown.outcome == "success"),
            "timestamp": (frame / self._fps).astype(np.float32),
            "frame_index": frame,
            "episode_index": np.full(n, len(self.lengths), np.int64),
            "index": frame + sum(self.lengths),
            "task_index": np.full(n, task, np.int64),
        }

    def _features(self) -> dict[str, Any]:
        names = {"observation.state": state_names(), "observation.forces": force_names(), "action": action_names()}
        features: dict[str, Any] = {}
        for name, (first, *_) in self._all.items():
            size = int(np.prod(first.shape[1:]))
            features[name] = {"dtype": str(first.dtype), "shape": [size], "names": names.get(name)}
        if self._shades.count:
            height, width, colours = self._shades.shape
            told = {"names": ["height", "width", "channels"], "info": film_info((height, width), self._fps)}
            features[self._film] = {"dtype": "video", "shape": [height, width, colours], **told}
        return features

    def _info(self) -> dict[str, Any]:
        info = {
            "codebase_version": self._layout, "robot_type": "trocar", "total_episodes": len(self.lengths),
            "total_frames": sum(self.lengths), "total_tasks": len(self._tasks), "chunks_size": CHUNK, "fps": self._fps,
            "splits": {"train": f"0:{len(self.lengths)}"}, "data_path": self._data_path,
            "video_path": self._video_path if self._film else None, "features": self._features(),
        }  # fmt: skip
        if self._layout == "v3.0":
            return {**info, "data_files_size_in_mb": DATA_MB, "video_files_size_in_mb": VIDEO_MB}
        videos = len(self.lengths) if self._film else 0
        return {**info, "total_videos": videos, "total_chunks": -(-len(self.lengths) // CHUNK)}

    def _path(self, pattern: str, number: int, **more: str) -> Path:
        """Return the place of a file by its number: of an episode, or in version 3.0 of a file of several."""
        chunk, rest = number // CHUNK, number % CHUNK
        return self._folder / pattern.format(
            chunk_index=chunk, file_index=rest, episode_chunk=chunk, episode_index=number, **more
        )

    def _write_data(self, columns: dict[str, Values], number: int) -> dict[str, int]:
        """Write the moments of an episode, or keep them for a file of several; return the place in version 3.0."""
        table = _table(columns)
        if self._layout == "v2.1":
            _write_parquet(self._path(self._data_path, number), table)
            return {}
        if sum(each.nbytes for each in self._pending) + table.nbytes > DATA_MB << 20:
            self._flush_data()
        self._pending.append(table)
        return {"data/chunk_index": self._data_file // CHUNK, "data/file_index": self._data_file % CHUNK}

    def _flush_data(self) -> None:
        import pyarrow

        if self._pending:
            _write_parquet(self._path(self._data_path, self._data_file), pyarrow.concat_tables(self._pending))
            self._pending, self._data_file = [], self._data_file + 1

    def _write_meta_3(self, all_stats: Stats) -> None:
        self._write_text("meta/stats.json", json.dumps(_plain(all_stats), indent=4))
        rows = [
            {
                **{name: value for name, value in row.items() if name != "stats"},
                **{f"stats/{f}/{kind}": _plain(v) for f, of in row["stats"].items() for kind, v in of.items()},
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
            }
            for row in self._episodes
        ]
        import pyarrow

        _write_parquet(self._path(_EPISODES, 0), pyarrow.Table.from_pylist(rows))
        _write_parquet(self._folder / "meta/tasks.parquet", _tasks_table(self._tasks))

    def _write_meta_2(self) -> None:
        lines = [{key: row[key] for key in ("episode_index", "tasks", "length")} for row in self._episodes]
        stats = [{"episode_index": row["episode_index"], "stats": _plain(row["stats"])} for row in self._episodes]
        tasks = [{"task_index": number, "task": task} for number, task in enumerate(self._tasks)]
        for name, rows in (("episodes", lines), ("episodes_stats", stats), ("tasks", tasks)):
            self._write_text(f"meta/{name}.jsonl", "".join(json.dumps(row) + "\n" for row in rows))

    def _write_text(self, name: str, text: str) -> None:
        path = self._folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def _stats(values: Values) -> dict[str, Any]:
    """Return the statistics of each number over moments (n, ...)."""
    flat = values.reshape(len(values), -1).astype(np.float64)
    found = {"min": flat.min(axis=0), "max": flat.max(axis=0), "mean": flat.mean(axis=0), "std": flat.std(axis=0)}
    quantiles = np.quantile(flat, _QUANTILES, axis=0)
    named = {_quantile_name(share): each for share, each in zip(_QUANTILES, quantiles, strict=True)}
    return {**found, "count": np.array([len(values)]), **named}


class _ImageShades:
    """How often each shade of each colour is in pictures: their statistics to the last digit, however many they are.

    Attributes:
        shape: Height, width and colours of every picture; zeros before the first.
        count: Number of pictures.
    """

    def __init__(self) -> None:
        self.shape, self.count = (0, 0, 0), 0
        self._times = np.zeros((3, _SHADES), np.int64)

    def take_some(self, images: Iterable[Values], every: int) -> Iterator[Values]:
        """Yield pictures, adding one of so many to the statistics on its way."""
        for number, image in enumerate(images):
            if number % every == 0:
                self.add(image)
            yield image

    def add(self, image: Values) -> None:
        """Add a picture."""
        self.shape = (image.shape[0], image.shape[1], image.shape[2])
        for times, colour in zip(self._times, np.moveaxis(image, 2, 0), strict=True):
            times += np.bincount(colour.reshape(-1), minlength=_SHADES)
        self.count += 1

    def add_all(self, other: _ImageShades) -> None:
        """Add the pictures of others."""
        self.shape = other.shape
        self._times += other._times
        self.count += other.count

    def stats(self) -> dict[str, Any]:
        """Return the statistics of each colour, from 0 to 1."""
        each = [_shade_stats(times) for times in self._times]
        found = {name: np.array([of[name] for of in each]).reshape(-1, 1, 1) for name in each[0]}
        return {**found, "count": np.array([self.count])}


def _shade_stats(times: Values) -> dict[str, float]:
    """Return the statistics of one colour by how often each shade is there, as NumPy has them of all values."""
    shades, up_to = np.arange(_SHADES) / (_SHADES - 1.0), np.cumsum(times)
    n, present = int(up_to[-1]), np.flatnonzero(times)
    mean = float(shades @ times) / n
    std = float(np.sqrt((shades - mean) ** 2 @ times / n))
    found = {"min": float(shades[present[0]]), "max": float(shades[present[-1]]), "mean": mean, "std": std}
    for share in _QUANTILES:
        place = share * (n - 1)
        low, high = (shades[np.searchsorted(up_to, k, side="right")] for k in (int(place), min(int(place) + 1, n - 1)))
        found[_quantile_name(share)] = float(low + (high - low) * (place - int(place)))
    return found


def _quantile_name(share: float) -> str:
    return f"q{round(100 * share):02d}"


def _plain(value: Any) -> Any:
    """Return statistics as JSON has them."""
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


def _table(columns: dict[str, Values]) -> Any:
    """Return columns as a table: vectors as lists of a fixed length."""
    import pyarrow

    def column(values: Values) -> Any:
        if values.ndim == 1:
            return pyarrow.array(values)
        return pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(values.reshape(-1)), values.shape[1])

    return pyarrow.table({name: column(values) for name, values in columns.items()})


def _tasks_table(tasks: list[str]) -> Any:
    """Return the tasks as pandas writes a table whose index they are."""
    import pyarrow

    index = "__index_level_0__"
    about = {
        "index_columns": [index],
        "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
            {"name": None, "field_name": index, "pandas_type": "unicode", "numpy_type": "object"},
        ],
    }
    numbers = pyarrow.array(range(len(tasks)), pyarrow.int64())
    table = pyarrow.table({"task_index": numbers, index: pyarrow.array(tasks, pyarrow.string())})
    return table.replace_schema_metadata({"pandas": json.dumps(about)})


def _write_parquet(path: Path, table: Any) -> None:
    from pyarrow import parquet

    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(table, path)
