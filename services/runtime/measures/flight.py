"""The flight recorder of a loop: its last two seconds, tick by tick, in shared memory.

A process writes one row a tick: the tick of the rig, its due, start and end times, the processor time of its thread
since the last one, and the duration of each stage. Writing is one copy into existing memory, without allocation or
locks. The memory is a file that never touches a disk, which others read without involving the loop: the page's process
after a miss, ``trocar diagnose latency`` at any time, even of a process that hangs or has died.
"""

from __future__ import annotations

import json
import math
import mmap
import os
import struct
import zlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from trocar.services.runtime.private_directory import make_private, open_private

MAGIC = b"TROCARF1"
#: First columns of a row, in ns; the stages follow.
COLUMNS = ("tick", "due_ns", "began_ns", "ended_ns", "ran_ns")
#: Twice as long as those who read it let pass between two looks (`LOOK_S`), so that none is missed.
SECONDS = 2.0
LOOK_S = 0.5 * SECONDS  # half of it
SUFFIX = ".flight"
#: Size of the header (magic, length of a JSON object, the object), a page of memory, and of the number of rows ever
#: written, a cache line, as it is written every tick. The ring of rows follows.
HEADER_BYTES, _COUNT_BYTES = 4096, 64
ROWS_AT = HEADER_BYTES + _COUNT_BYTES
MEMORY = Path("/dev/shm")


class FlightRing:
    """The last ticks of one loop, written by one thread.

    Attributes:
        stages: Names of a tick's stages, in order.
        written: Number of rows since the start; the ring keeps the newest `capacity`.
    """

    def __init__(self, rate_hz: float, stages: Sequence[str] = ()) -> None:
        self.rate_hz = rate_hz
        self.stages = tuple(stages)
        self.capacity = max(64, math.ceil(SECONDS * rate_hz))
        self.written = 0
        row = struct.Struct(f"<{len(COLUMNS) + len(self.stages)}q")
        self.row_bytes = row.size
        self._pack = row.pack_into
        self.memory: bytearray | mmap.mmap
        self._use(bytearray(ROWS_AT + self.capacity * self.row_bytes))

    def _use(self, memory: bytearray | mmap.mmap) -> None:
        self.memory = memory
        self._count = memoryview(memory)[HEADER_BYTES : HEADER_BYTES + 8].cast("q")

    def write(
        self, tick: int, due_ns: int, began_ns: int, ended_ns: int, ran_ns: int, stages_ns: Sequence[int]
    ) -> None:
        """Write a row; `stages_ns` has a number for each stage."""
        place = ROWS_AT + self.written % self.capacity * self.row_bytes
        self._pack(self.memory, place, tick, due_ns, began_ns, ended_ns, ran_ns, *stages_ns)
        self.written += 1
        self._count[0] = self.written

    def share(self, path: Path) -> None:
        """Move the ring to the new file `path` in a private directory, discarding its rows.

        Raises BusError or OSError if it cannot be created.
        """
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
        descriptor = open_private(temporary, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        try:
            size = ROWS_AT + self.capacity * self.row_bytes
            os.posix_fallocate(descriptor, 0, size)  # a lack of memory fails here, not by a signal in a tick
            memory = mmap.mmap(descriptor, size)
            memory[:] = bytes(size)  # touches every page before the first tick
            header = json.dumps(self._header(path.name.removesuffix(SUFFIX))).encode()
            struct.pack_into(f"<8sI{len(header)}s", memory, 0, MAGIC, len(header), header)
            os.replace(temporary, path)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise
        finally:
            os.close(descriptor)
        self.written = 0
        self._use(memory)

    def _header(self, name: str) -> dict[str, Any]:
        return {
            "name": name,
            "pid": os.getpid(),
            "rate_hz": self.rate_hz,
            "cores": sorted(os.sched_getaffinity(0)),
            "stages": self.stages,
            "capacity": self.capacity,
        }


def flight_directory(run_directory: Path) -> Path:
    """Return the directory of a rig's rings: `run_directory` if it is in memory, else one in ``/dev/shm``.

    Pages of a file on a disk are locked while they are written back, and a writer then waits for the disk.
    Raises BusError if it cannot be created, or is accessible to others.
    """
    if is_memory(run_directory) or not MEMORY.is_dir():
        return run_directory
    whose = make_private(MEMORY / f"trocar-{os.getuid()}")
    return make_private(whose / f"{zlib.crc32(os.fsencode(run_directory.absolute())):08x}")


def is_memory(directory: Path) -> bool:
    """Return whether a directory is on a memory file system."""
    device = directory.stat().st_dev
    wanted = f"{os.major(device)}:{os.minor(device)}"
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        fields, _, rest = line.partition(" - ")
        if fields.split()[2] == wanted:
            return rest.split()[0] == "tmpfs"
    return False


def remove_rings(run_directory: Path) -> None:
    """Remove the rings of a rig that has ended, and what else its processes share there."""
    directory = flight_directory(run_directory)
    for path in directory.glob(f"*{SUFFIX}"):
        path.unlink(missing_ok=True)
    if directory != run_directory:
        with suppress(OSError):  # not empty: a process is still writing
            directory.rmdir()
