"""What reading a file may cost: in proportion to its bytes, so that a small file cannot cost much."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

#: Of the smallest file, and what each of its bytes adds. A megabyte of text takes a second to read, one of a recording
#: half a second; a byte of text becomes up to twenty in memory. Three times as much computing is allowed, and an answer
#: with twice as much memory:
_MEMORY_BYTES, _MEMORY_A_BYTE = 640 << 20, 20
_CPU_S, _CPU_S_A_BYTE = 6.0, 3e-6
_ANSWER_BYTES, _ANSWER_A_BYTE = 256 << 20, 40
#: Of time that passes to computing time, as a busy machine has other things to do.
_WAIT = 4.0


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one reading.

    Attributes:
        memory_bytes: Memory beyond that of a reader that has read nothing.
        cpu_s: Computing time.
        wait_s: Time for which an answer is waited for, all parts of it together.
        answer_bytes: Size of the answer.
    """

    memory_bytes: int
    cpu_s: float
    wait_s: float
    answer_bytes: int


def limits_of(*paths: Path) -> Limits:
    """Return the limits of reading some files; one that is not there counts nothing."""
    size = sum(map(_size, paths))
    cpu_s = _CPU_S + _CPU_S_A_BYTE * size
    return Limits(
        memory_bytes=_MEMORY_BYTES + _MEMORY_A_BYTE * size,
        cpu_s=cpu_s,
        wait_s=_WAIT * cpu_s,
        answer_bytes=_ANSWER_BYTES + _ANSWER_A_BYTE * size,
    )


def _size(path: Path) -> int:
    """Return the bytes of a file that are on the disk: a file may be as long as it says, and hold nothing."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return 0
    return min(status.st_size, 512 * status.st_blocks)
