"""What a surface file says of itself before its triangles are read: how many there are, and whether it is whole."""

from __future__ import annotations

import re
import stat
from pathlib import Path

from trocar.services.meshes.errors import MeshError

MOST_TRIANGLES_READ = 2_000_000
"""Reading and repairing takes about a kilobyte and 10 to 30 µs a triangle."""
BYTES_READ = 1_000
STL_HEADER, STL_TRIANGLE = 84, 50
TEXT_BYTES = {".stl": 250, ".obj": 45}
"""Bytes that a triangle takes in a text file, about."""


def judge_place(path: Path) -> None:
    """Refuse what is no file, or one that this user may not read.

    Raises MeshError that names the file and the reason.
    """
    try:
        mode = path.stat().st_mode
        if stat.S_ISREG(mode):
            path.open("rb").close()
    except FileNotFoundError:
        raise MeshError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # a closed folder; a name that no file can have
        raise MeshError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(mode):
        raise MeshError(f"{path}: is a {'folder' if stat.S_ISDIR(mode) else 'device or a pipe'}, not a file")


def judge_file(path: Path) -> int:
    """Return how many faces a file announces, or about how many it can hold.

    One that is empty, cut off, or holds more triangles than are read is refused.
    Raises MeshError that names the file, what it announces, and what there is.
    """
    size = path.stat().st_size
    if not size:
        raise MeshError(f"{path}: the file is empty")
    with path.open("rb") as file:
        head = file.read(4096)
        file.seek(max(0, size - 1024))
        tail = file.read()
    count = _COUNTERS[path.suffix.lower()](path, size, head, tail)
    if count > MOST_TRIANGLES_READ:
        raise MeshError(
            f"{path}: about {count:.3g} triangles, which take {1e-9 * BYTES_READ * count:.2g} GB to repair; at most "
            f"{MOST_TRIANGLES_READ:.3g} are read, decimate the surface first"
        )
    return count


def _count_stl(path: Path, size: int, head: bytes, tail: bytes) -> int:
    announced = int.from_bytes(head[80:84], "little")
    if head[:5].lower() != b"solid" or size == STL_HEADER + STL_TRIANGLE * announced:
        held = max(0, size - STL_HEADER) // STL_TRIANGLE
        if held < announced:
            raise MeshError(f"{path}: the file is cut off, it announces {announced} triangles and holds {held}")
        if size != STL_HEADER + STL_TRIANGLE * announced:
            raise MeshError(
                f"{path}: announces {announced} triangles, which take {STL_HEADER + STL_TRIANGLE * announced} bytes, "
                f"and has {size}: what is the rest?"
            )
        return announced
    if b"endsolid" not in tail.lower():
        raise MeshError(f"{path}: the file is cut off, it does not end with 'endsolid'")
    return size // TEXT_BYTES[".stl"]


def _count_obj(path: Path, size: int, head: bytes, tail: bytes) -> int:
    return size // TEXT_BYTES[".obj"]


def _count_ply(path: Path, size: int, head: bytes, tail: bytes) -> int:
    found = re.search(rb"element\s+face\s+(\d+)", head)
    if not head.startswith(b"ply") or found is None:
        raise MeshError(f"{path}: does not begin as a PLY file with faces does")
    return int(found[1])


def _count_vtp(path: Path, size: int, head: bytes, tail: bytes) -> int:
    if b"<VTKFile" not in head:
        raise MeshError(f"{path}: does not begin as a VTP file does")
    if b"</VTKFile>" not in tail:
        raise MeshError(f"{path}: the file is cut off, it does not end with '</VTKFile>'")
    found = re.search(rb'NumberOfPolys="\s*(\d+)', head)
    return int(found[1]) if found else 0


_COUNTERS = {".stl": _count_stl, ".obj": _count_obj, ".ply": _count_ply, ".vtp": _count_vtp}
