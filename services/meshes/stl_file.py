"""Triangles of STL files, binary or text; each has corners of its own."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from trocar.services.meshes.announced import cut_off, judge_counts
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.file_kind import STL_HEADER, STL_TRIANGLE, plain_text
from trocar.services.meshes.surface_data import DoubleArray, SurfaceData

_TEXT_BYTES = 1000
"""More than any triangle of a text takes: twelve numbers of at most 25 characters, words and blanks."""
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_BLANKS = b"\0 \t\r\n"
_NUMBER = rb"([-+.\deE]+|[-+]?(?:nan|inf)\w*)"
_VERTEX = re.compile(rb"\bvertex\s+" + rb"\s+".join([_NUMBER] * 3) + rb"(?=\s+(?:vertex|endloop)\b)", re.IGNORECASE)
_LOOP = re.compile(rb"\bouter\s+loop\s+vertex\b", re.IGNORECASE)
_END = re.compile(rb"\bend[ \t]*solid\b[^\r\n]*\Z", re.IGNORECASE)


def read_binary_stl(path: Path) -> SurfaceData:
    """Return the triangles that the header announces.

    Raises MeshError if there are fewer, or if what is behind them is triangles too.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        announced = int.from_bytes(file.read(STL_HEADER + 4)[STL_HEADER:], "little")
        held = max(0, size - STL_HEADER - 4) // STL_TRIANGLE
        if held < announced:
            raise cut_off(path, announced, "triangles", held)
        judge_counts(path, announced)
        records = np.frombuffer(file.read(STL_TRIANGLE * announced), _RECORD)
        rest = file.read()
    actions = []
    if rest:
        if len(rest) % STL_TRIANGLE == 0 and rest.strip(_BLANKS):
            wanted = size - len(rest)
            raise MeshError(
                f"{path}: announces {announced} triangles, which take {wanted} bytes, and has {size}: what is the rest?"
            )
        actions.append(f"left {len(rest)} bytes behind the last triangle unread")
    return _triangles(records["corners"].reshape(-1, 3).astype(np.float64), actions)


def read_text_stl(path: Path) -> SurfaceData:
    """Return the triangles of a text.

    Raises MeshError if it does not end as such a text does, or a triangle is none.
    """
    judge_counts(path, path.stat().st_size // _TEXT_BYTES)
    text = plain_text(path.read_bytes()).rstrip(_BLANKS)
    if not _END.search(text[max(0, text.rfind(b"endfacet")) :]):
        raise MeshError(f"{path}: the file is cut off, it does not end with 'endsolid'")
    found = [match.groups() for match in _VERTEX.finditer(text)]
    loops = sum(1 for _ in _LOOP.finditer(text))
    judge_counts(path, loops)
    if len(found) != 3 * loops:
        raise MeshError(f"{path}: has {len(found)} vertices in {loops} triangles, a triangle has three")
    return _triangles(np.array(found, dtype=np.bytes_).astype(np.float64).reshape(-1, 3), [])


def _triangles(corners: DoubleArray, actions: list[str]) -> SurfaceData:
    n = len(corners) // 3
    return SurfaceData(corners, np.arange(3 * n), np.full(n, 3), actions=actions)
