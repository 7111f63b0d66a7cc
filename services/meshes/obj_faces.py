"""Whether the faces of an OBJ file name vertices that it has: its readers take some that it has not for others."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from services.meshes.errors import MeshError

_FURTHER = re.compile(rb"/\S*")
"""What follows a vertex in a face: its texture and its normal."""


def judge_faces(path: Path) -> None:
    """Refuse a face that names no vertex of the file; they count from 1, or back from -1.

    Raises
    ------
    MeshError
        Names the line, the vertex, and how many there are.
    """
    lines = path.read_bytes().replace(b"\\\n", b" ").split(b"\n")
    n_vertices = sum(line.startswith((b"v ", b"v\t")) for line in lines)
    faces = [line[1:] for line in lines if _is_face(line)]
    if _are_named(_FURTHER.sub(b"", b" ".join(faces)).split(), n_vertices):
        return
    for number, line in enumerate(lines, 1):
        for vertex in _FURTHER.sub(b"", line[1:]).split() if _is_face(line) else ():
            if not _are_named([vertex], n_vertices):
                raise MeshError(
                    f"{path}: line {number}: a face names vertex '{vertex.decode(errors='replace')}', the file has "
                    f"{n_vertices}, which count from 1"
                )


def _is_face(line: bytes) -> bool:
    return line.startswith((b"f ", b"f\t"))


def _are_named(vertices: list[bytes], n_vertices: int) -> bool:
    try:
        named = np.abs(np.array(vertices, dtype="S").astype(np.int64))
    except ValueError:
        return False
    return not named.size or bool(named.min() >= 1 and named.max() <= n_vertices)
