"""Cyclic symmetry: a surface that is its own copy, turned about x by a whole part of a full turn."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.surface.mesh import TriangleMesh

_APART = 1e-9
"""Copies of vertices are found within this share of the surface's size."""


@dataclass(frozen=True, slots=True)
class CyclicSymmetry:
    """Sectors round the x axis, each the first one turned.

    Attributes:
        n_sectors: int
        seat: (n,) int32. Which node of the first sector each node is a copy of, 0 to n / n_sectors - 1.
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
    """Return the sectors, as many as there are, of a mesh whose held nodes and triangles turn into each other.

    None where there are not at least two, or where a node lies on the axis.
    """
    from scipy.spatial import cKDTree  # only here, see `residual.patches`: a tenth of the start of a process

    held = mesh.vertex_sets.get("clamped")
    if held is None:
        return None
    tree, triangles = cKDTree(mesh.vertices_m), _sorted_rows(mesh.triangles)
    reach_m = _APART * float(np.ptp(mesh.vertices_m, axis=0).max())
    for n_sectors in range(len(held), 1, -1):
        if len(held) % n_sectors:
            continue
        found = tree.query(turned_about_x(mesh.vertices_m, 2.0 * math.pi / n_sectors))
        away_m, image = np.asarray(found[0]), np.asarray(found[1], np.int32)
        if (
            away_m.max() <= reach_m
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
