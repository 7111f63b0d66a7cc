"""What every surface format comes to: vertices, and faces of any number of corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Int64Array = npt.NDArray[np.int64]
DoubleArray = npt.NDArray[np.float64]


@dataclass(slots=True)
class SurfaceData:
    """A surface as it stands in a file.

    Attributes:
        vertices: (n, 3) positions in the file's unit.
        corners: (sum of counts,) vertices of all faces, one face behind the other.
        counts: (faces,) corners of each face.
        lines: Line of each face in the file, of a format whose faces have one.
        actions: What was left out or understood in reading.
        sets: Vertices of each named group of the file, ascending.
    """

    vertices: DoubleArray
    corners: Int64Array
    counts: Int64Array
    lines: Sequence[int] = ()
    actions: list[str] = field(default_factory=list)
    sets: Mapping[str, Int64Array] = field(default_factory=dict)


def strip_triangles(strip: Int64Array) -> Int64Array:
    """Return the triangles (k, 3) of a strip, whose every second one is wound the other way.

    A strip that holds -1 is several: the format says so.
    """
    parts = np.split(strip, np.flatnonzero(strip < 0))
    return np.concatenate([_one_strip(part[part >= 0] if k else part) for k, part in enumerate(parts)])


def _one_strip(strip: Int64Array) -> Int64Array:
    if len(strip) < 3:
        return np.zeros((0, 3), np.int64)
    triangles = np.lib.stride_tricks.sliding_window_view(strip, 3).copy()
    triangles[1::2] = triangles[1::2, ::-1]
    return triangles
