"""Vertices and faces of an OBJ file, numbered as in the file.

Its readers number vertices anew where faces name textures or normals too, count back from the last vertex of the file
where a face counts back from those above it, and take vertices that are not there for others.
"""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.meshes.errors import MeshError


def read_obj(path: Path) -> tuple[FloatArray, IntArray]:
    """Return (n, 3) vertices in the file's unit and (m, 3) triangles; polygons are split round their first corner.

    Raises MeshError that names the line of a vertex or a face that is none.
    """
    vertices: list[tuple[float, ...]] = []
    triangles: list[tuple[int, int, int]] = []
    lines: list[int] = []
    for number, words in _statements(path):
        if words[0] == b"v":
            vertices.append(_position(words[1:4], f"{path}: line {number}"))
        elif words[0] == b"f":
            corners = [_vertex(word, len(vertices)) for word in words[1:]]
            if len(corners) < 3:
                raise MeshError(f"{path}: line {number}: a face has {len(corners)} corners")
            triangles += [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
            lines += [number] * (len(corners) - 2)
    named = np.array(triangles, np.int64).reshape(-1, 3)
    strange = np.flatnonzero(((named < 0) | (named >= len(vertices))).any(axis=1))
    if len(strange):
        raise MeshError(f"{path}: {_who_is_named(path, lines[strange[0]], len(vertices))}")
    return np.array(vertices).reshape(-1, 3), named.astype(np.int32)


def _statements(path: Path) -> Iterator[tuple[int, list[bytes]]]:
    """Yield the number and the words of each line that has any; one ends with its comment, or is carried on."""
    data = path.read_bytes()
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.decode("utf-16", "replace").encode()
    data = data.removeprefix(codecs.BOM_UTF8)
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
        position = tuple(map(float, words))
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
        return -1
    place = named - 1 if named > 0 else n_above + named
    return place if named and place < 2**31 else -1


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
    return word.decode(errors="replace")
