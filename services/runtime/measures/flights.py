"""Reading flight rings of a running or dead rig, and saving them in files."""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.services.runtime.errors import BusError, ConfigError
from trocar.services.runtime.measures.flight import COLUMNS, HEADER_BYTES, MAGIC, ROWS_AT, SUFFIX
from trocar.services.runtime.private_directory import open_private

#: Suffix of files with flights, in numpy's format.
FILE_SUFFIX = ".npz"
#: Loops faster than this affect the hand; a late picture is no incident.
FAST_HZ = 500.0
_META = "about"
_PREFIX = len(MAGIC) + 4
#: Exceptions of reading a file that is no ring.
_NO_RING = (OSError, ValueError, KeyError, TypeError, struct.error)
#: Exceptions of reading a file without flights, or a damaged one; the last is of another kind of zip file.
_NO_FLIGHTS = (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError)


@dataclass(frozen=True, slots=True)
class Flight:
    """The last ticks of one loop.

    Attributes:
        rows: (ticks, 5 + stages) int64. Columns are `trocar.services.runtime.measures.flight.COLUMNS`, then the stages;
        oldest first.
    """

    name: str
    pid: int
    rate_hz: float
    cores: tuple[int, ...]
    stages: tuple[str, ...]
    rows: NDArray[np.int64] = field(repr=False)

    @property
    def period_ns(self) -> float:
        """Period of the ticks."""
        return 1e9 / self.rate_hz

    def column(self, name: str) -> NDArray[np.int64]:
        """Return one of `COLUMNS` for all ticks."""
        found: NDArray[np.int64] = self.rows[:, COLUMNS.index(name)]
        return found


@dataclass(frozen=True, slots=True)
class ThreadTime:
    """The kernel's times of one thread over the last `seconds`: on a processor, and waiting for one."""

    process: str
    thread: str
    seconds: float
    ran_s: float
    waited_s: float
    switches: int


@dataclass(frozen=True, slots=True)
class Flights:
    """The flights of a rig at one time, with the reason of saving; `threads` is empty if the kernel reports none."""

    flights: tuple[Flight, ...]
    taken_ns: int
    taken_at: str
    reason: str = ""
    threads: tuple[ThreadTime, ...] = ()


def read_rings(directory: Path) -> tuple[Flight, ...]:
    """Return the flights in a directory of rings, except those of another version."""
    found = (read_ring(path) for path in sorted(directory.glob(f"[!.]*{SUFFIX}")))
    return tuple(flight for flight in found if flight is not None)


def read_ring(path: Path) -> Flight | None:
    """Return the rows of a ring, also while it is being written; None for another file."""
    try:
        descriptor = open_private(path, os.O_RDONLY)
    except (FileNotFoundError, BusError):
        return None
    try:
        return _read(descriptor)
    except _NO_RING:
        return None
    finally:
        os.close(descriptor)


def open_ring(path: Path, pid: int) -> int | None:
    """Return a descriptor of the ring at `path`, for `rows_written`; None if it is not of process `pid`."""
    try:
        descriptor = open_private(path, os.O_RDONLY)
    except (FileNotFoundError, BusError):
        return None
    try:
        about = _about(descriptor)
        if about is not None and int(about["pid"]) == pid:
            return descriptor
    except _NO_RING:
        pass
    os.close(descriptor)
    return None


def rows_written(descriptor: int) -> int:
    """Return the number of rows ever written to a ring."""
    (count,) = struct.unpack("<q", os.pread(descriptor, 8, HEADER_BYTES))
    return int(count)


def _about(descriptor: int) -> dict[str, Any] | None:
    """Return the header of a ring, None for another file."""
    head = os.pread(descriptor, HEADER_BYTES, 0)
    if head[: len(MAGIC)] != MAGIC:
        return None
    (length,) = struct.unpack_from("<I", head, len(MAGIC))
    about: dict[str, Any] = json.loads(head[_PREFIX : _PREFIX + length])
    return about


def _read(descriptor: int) -> Flight | None:
    about = _about(descriptor)
    if about is None:
        return None
    capacity, columns = int(about["capacity"]), len(COLUMNS) + len(about["stages"])
    before = rows_written(descriptor)
    data = os.pread(descriptor, 8 * capacity * columns, ROWS_AT)
    after = rows_written(descriptor)
    rows = np.frombuffer(data, np.int64).reshape(capacity, columns)
    # The writer may have been writing the row after the last counted one, over the oldest.
    whole = np.arange(max(0, after - capacity + 1), before)
    cores, stages = tuple(map(int, about["cores"])), tuple(map(str, about["stages"]))
    return Flight(str(about["name"]), int(about["pid"]), float(about["rate_hz"]), cores, stages, rows[whole % capacity])


def to_bytes(flights: Flights) -> bytes:
    """Return the contents of a file."""
    about = {
        "taken_ns": flights.taken_ns,
        "taken_at": flights.taken_at,
        "reason": flights.reason,
        "threads": [asdict(thread) for thread in flights.threads],
        "flights": [
            {"name": f.name, "pid": f.pid, "rate_hz": f.rate_hz, "cores": f.cores, "stages": f.stages}
            for f in flights.flights
        ],
    }
    arrays: dict[str, NDArray[Any]] = {f"rows{i}": flight.rows for i, flight in enumerate(flights.flights)}
    out = io.BytesIO()
    arrays[_META] = np.frombuffer(json.dumps(about).encode(), np.uint8)
    np.savez_compressed(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def read_file(path: Path) -> Flights:
    """Return the flights of a file. Raises ConfigError if it is invalid or unreadable."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            about = json.loads(bytes(data[_META]))
            flights = tuple(_flight(each, data[f"rows{i}"]) for i, each in enumerate(about["flights"]))
            threads = tuple(ThreadTime(**each) for each in about["threads"])
        return Flights(flights, int(about["taken_ns"]), str(about["taken_at"]), str(about["reason"]), threads)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or 'is no file of flights'}") from None
    except _NO_FLIGHTS:
        raise ConfigError(f"{path}: is no file of flights; `trocar latency` without a file looks at the rig") from None


def _flight(about: dict[str, Any], rows: NDArray[Any]) -> Flight:
    stages: Sequence[str] = tuple(map(str, about["stages"]))
    if rows.dtype != np.int64 or rows.ndim != 2 or rows.shape[1] != len(COLUMNS) + len(stages):
        raise ValueError("rows do not fit their stages")
    cores = tuple(map(int, about["cores"]))
    return Flight(str(about["name"]), int(about["pid"]), float(about["rate_hz"]), cores, tuple(stages), rows)


def overrun_ns(flight: Flight) -> NDArray[np.float64]:
    """Return the time from its deadline to the end of each tick, (ticks,); negative if in time."""
    return np.asarray(flight.column("ended_ns") - flight.column("due_ns") - flight.period_ns, np.float64)


def worst_ns(flights: Iterable[Flight], min_rate_hz: float = 0.0) -> float:
    """Return the largest overrun of loops of at least `min_rate_hz`, 0 if all were in time."""
    late = (overrun_ns(f).max(initial=0.0) for f in flights if f.rate_hz >= min_rate_hz and len(f.rows))
    return float(max(late, default=0.0))
