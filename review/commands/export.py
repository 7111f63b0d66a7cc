"""``trocar export``: a recording as tables for whoever has other tools, or as a film."""

from __future__ import annotations

import csv
from collections.abc import Collection, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

from trocar.protocol import TOPICS
from trocar.review.export.tables import TopicColumns, read_columns
from trocar.services.cli import targets
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.errors import ConfigError, MissingPackageError

#: Entry points of what is built upon this package.
_EXPORTS = "trocar.exports"
#: Formats, and what holds them beside the recording.
FORMATS = {"csv": "a folder", "parquet": "a folder", "npz": "a file", "mp4": "a file"}


def run_export(file: Path, to: str, out: Path | None, topics: Collection[str], view: str = "scope") -> None:
    """Write what a recording holds in another form, and say where; a film shows it in a view.

    Raises RecordingError if it is no recording, holds nothing of the topics, or a package is missing that the form
    needs.
    """
    for topic in topics:
        if topic not in TOPICS:
            raise ConfigError(f"there is no topic {topic!r}{did_you_mean(topic, TOPICS)}")
    place = out or file.with_suffix("" if FORMATS[to] == "a folder" else f".{to}")
    if to == "mp4":
        from trocar.review.export.film import write_film

        write_film(file, place, view)
    elif to == "npz":
        arrays = {f"{t}.{name}": a for t, c in read_columns(file, topics).items() for name, a in c.arrays().items()}
        place.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(place, **arrays)  # type: ignore[arg-type]
    else:
        write = {"csv": _write_csv, "parquet": _write_parquet}[to]
        if to == "parquet":
            _need("pyarrow", to)
        tables = read_columns(file, topics)
        place.mkdir(parents=True, exist_ok=True)
        for topic, columns in tables.items():
            write(place / f"{topic}.{to}", columns)
    print(place)


def export_dataset(files: Sequence[Path], out: Path | None, **options: Any) -> None:
    """Write recordings as one dataset, and say where: by whoever offers it as an entry point of `_EXPORTS`."""
    (found,) = entry_points(group=_EXPORTS, name="lerobot")
    place = out or files[0].with_suffix(".lerobot")
    targets.make_folder("--out", place.absolute().parent)
    with targets.writing("--out", place):
        said = found.load()(files, place, **options)
    print(said)


def _need(package: str, to: str) -> None:
    try:
        __import__(package)
    except ModuleNotFoundError:
        raise MissingPackageError(to, package) from None


def _write_csv(path: Path, columns: TopicColumns) -> None:
    flat = columns.flat()
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(flat)
        writer.writerows(zip(*(column.tolist() for column in flat.values()), strict=True))


def _write_parquet(path: Path, columns: TopicColumns) -> None:
    import pyarrow
    from pyarrow import parquet

    parquet.write_table(pyarrow.table(columns.flat()), path)
