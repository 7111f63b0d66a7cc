"""Cyclic symmetry: a surface that maps to itself when turned about x by a fraction 1 / n of a full turn."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh

_APART = 1e-9
"""Tolerance for finding copies of vertices, as a fraction of the surface's size."""
_ACROSS = np.array([1.0, math.sqrt(2.0), math.sqrt(3.0)])
"""A direction along which hardly any two vertices of a regular mesh have the same coordinate."""


@dataclass(frozen=True, slots=True)
class CyclicSymmetry:
    """Sectors round the x axis, each a rotated copy of the first.

    Attributes:
        n_sectors: int
        seat: (n,) int32. Node of the first sector of which each node is a copy, 0 to n / n_sectors - 1.
        sector: (n,) int32
    """

    n_sectors: int
    seat: IntArray
    sector: IntArray

    @property
    def first(self) -> IntArray:
        """Nodes of the first sector, in order of their seats."""
        nodes = np.flatnonzero(self.sector == 0).astype(np.int32)
        return nodes[np.argsort(self.seat[nodes])]

    @property
    def turns(self) -> FloatArray:
        """Cosine and sine (n_sectors, 2) of the angle by which each sector is turned."""
        angle = 2.0 * math.pi * np.arange(self.n_sectors) / self.n_sectors
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def find_cyclic_symmetry(mesh: TriangleMesh) -> CyclicSymmetry | None:
    """Return the sectors, as many as possible, of a mesh whose held nodes and triangles are symmetric.

    Return None if there are fewer than two, or if a node lies on the axis.
    """
    held = mesh.vertex_sets.get("clamped")
    if held is None:
        return None
    triangles = _sorted_rows(mesh.triangles)
    reach_m = _APART * float(np.ptp(mesh.vertices_m, axis=0).max())
    for n_sectors in range(len(held), 1, -1):
        if len(held) % n_sectors:
            continue
        image = _image(mesh.vertices_m, turned_about_x(mesh.vertices_m, 2.0 * math.pi / n_sectors), reach_m)
        if (
            image.min() >= 0
            and np.array_equal(_sorted_rows(image[mesh.triangles]), triangles)
            and np.array_equal(np.sort(image[held]), np.sort(held))
        ):
            return _sectors(image, n_sectors)
    return None


def turned_about_x(vectors: FloatArray, angle_rad: float) -> FloatArray:
    """Return vectors (..., 3) turned about x."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    turned: FloatArray = vectors @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    return turned


def _image(vertices_m: FloatArray, moved_m: FloatArray, reach_m: float) -> IntArray:
    """Return for each moved vertex the index of a vertex within reach of it, -1 if there is none.

    The search sorts along a line, because importing scipy's trees takes 50 ms in each process of a rig.
    """
    along_m, moved_along_m = vertices_m @ _ACROSS, moved_m @ _ACROSS
    order = np.argsort(along_m)
    within_m = np.linalg.norm(_ACROSS) * reach_m
    first = np.searchsorted(along_m[order], moved_along_m - within_m)
    last = np.searchsorted(along_m[order], moved_along_m + within_m, side="right")
    image = np.full(len(moved_m), -1, np.int32)
    for step in range(int((last - first).max())):
        moved = np.flatnonzero(first + step < last)
        near = order[first[moved] + step]
        is_there = np.linalg.norm(vertices_m[near] - moved_m[moved], axis=1) <= reach_m
        image[moved[is_there]] = near[is_there]
    return image


def _sectors(image: IntArray, n_sectors: int) -> CyclicSymmetry | None:
    copies: list[IntArray] = [np.arange(len(image), dtype=np.int32)]
    for _ in range(n_sectors - 1):
        copies.append(image[copies[-1]])
    first = np.flatnonzero(np.min(copies, axis=0) == copies[0])
    if len(first) * n_sectors != len(image):
        return None
    seat, sector = np.empty(len(image), np.int32), np.empty(len(image), np.int32)
    for number, copy in enumerate(copies):
        seat[copy[first]], sector[copy[first]] = np.arange(len(first)), number
    return CyclicSymmetry(n_sectors, seat, sector)


def _sorted_rows(triangles: IntArray) -> IntArray:
    rows = np.sort(triangles, axis=1)
    ordered: IntArray = rows[np.lexsort(rows.T)]
    return ordered
