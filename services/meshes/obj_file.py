"""Vertices and faces of an OBJ file, numbered as in the file.

Its readers number vertices anew where faces name textures or normals too, count back from the last vertex of the file
where a face counts back from those above it, and take vertices that are not there for others.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from trocar.services.meshes.announced import MOST_TRIANGLES_READ, judge_counts
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.file_kind import plain_text
from trocar.services.meshes.surface_data import SurfaceData

_TRIANGLE_BYTES = 6
"""Least of a text that a triangle takes: a blank and a digit for each of three corners, or for one more of a face."""
_NO_VERTEX = -1  # in the place of a number that is at least 0


def read_obj(path: Path) -> SurfaceData:
    """Return vertices and faces.

    Raises MeshError that names the line of a vertex or a face that is none.
    """
    vertices, corners, counts, lines = array("d"), array("q"), array("q"), array("q")
    triangles = 0
    for number, words in _statements(path):
        if words[0] == b"v":
            vertices.extend(_position(words[1:4], f"{path}: line {number}"))
        elif words[0] == b"f":
            triangles += max(0, len(words) - 3)
            if triangles > MOST_TRIANGLES_READ:
                judge_counts(path, max(triangles, path.stat().st_size // _TRIANGLE_BYTES))
            corners.extend([_vertex(word, len(vertices) // 3) for word in words[1:]])
            counts.append(len(words) - 1)
            lines.append(number)
    n = len(vertices) // 3
    judge_counts(path, triangles, n)
    named = np.array(corners, np.int64)
    strange = np.flatnonzero((named < 0) | (named >= n))
    if len(strange):
        face = int(np.searchsorted(np.cumsum(counts), strange[0], side="right"))
        raise MeshError(f"{path}: {_who_is_named(path, lines[face], n)}")
    return SurfaceData(np.array(vertices).reshape(-1, 3), named, np.array(counts, np.int64), lines)


def _statements(path: Path) -> Iterator[tuple[int, list[bytes]]]:
    """Yield the number and the words of each line that has any; one ends with its comment, or is carried on."""
    data = plain_text(path.read_bytes())
    carried: list[bytes] = []
    for number, line in enumerate(data.splitlines(), 1):
        words = line.partition(b"#")[0].split()
        if words and words[-1].endswith(b"\\"):
            carried += [*words[:-1], words[-1][:-1]]
            continue
        words = [word for word in carried if word] + words if carried else words
        carried = []
        if words:
            yield number, words


def _position(words: list[bytes], where: str) -> tuple[float, ...]:
    try:
        position = tuple(map(float, words)) if not any(b"_" in word for word in words) else ()
    except ValueError:
        position = ()
    if len(position) < 3:
        raise MeshError(f"{where}: '{_text(b' '.join(words))}' are not three coordinates")
    return position


def _vertex(word: bytes, n_above: int) -> int:
    """Place from 0 of the vertex that a corner names, among those that the file has; -1 where it can be none."""
    try:
        named = int(word.partition(b"/")[0])
    except ValueError:
        return _NO_VERTEX
    place = named - 1 if named > 0 else n_above + named
    return place if named and 0 <= place < 2**31 else _NO_VERTEX


def _who_is_named(path: Path, line: int, n_vertices: int) -> str:
    """Return which corner of a face is no vertex, in the words of the file."""
    n_above = 0
    for number, words in _statements(path):
        n_above += words[0] == b"v"
        if number == line:
            break
    word = next(word for word in words[1:] if not 0 <= _vertex(word, n_above) < n_vertices)
    vertex = _text(word.partition(b"/")[0])
    return f"line {line}: a face names vertex '{vertex}', the file has {n_vertices}, which count from 1"


def _text(word: bytes) -> str:
    return word[:100].decode(errors="replace")
