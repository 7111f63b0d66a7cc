"""A duct's lumen in cells along its way, by the triangles of its wall: closed volumes that share their borders.

Cells are made once, at rest, of triangles whose distance from the mouth is alike and that hang together, so that a fork
has cells of its own on each branch. A border between two cells is a fan over the loop of edges that they share. As the
same fan closes both, volumes add up to the lumen's, whatever the wall does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from trocar.services.mechanics.arrays import BoolArray, Float32Array, FloatArray, IntArray
from trocar.services.mechanics.bodies.lumen import winding_number
from trocar.services.mechanics.surface.centreline import surface_tree
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    half_edges,
    paired_half_edges,
    triangle_areas_m2,
)
from trocar.services.visualization.thick_wall import refine

_TRIANGLES_LONG = 1.5
"""Length of a cell in edges: at least one, or a triangle would reach from a cell to the next but one."""


@dataclass(frozen=True)
class Cap:
    """A fan over a loop of edges (e, 2), in the direction of the triangles of ``inner``; beyond it lies ``outer``."""

    edges: IntArray
    inner: int
    outer: int


class LumenCells:
    """The cells of a lumen whose wall is an open surface.

    Raises ValueError: the surface has no open rim.

    Args:
        rest_m: (n, 3). Vertices at rest.
        triangles: (t, 3). Counter-clockwise seen from outside.
        mouth: Vertices from which distance is measured, a rim.
        edge_m: Triangles are split in four until no edge is longer, which sets how fine the cells are.

    Attributes:
        triangles: (u, 3). The split wall, and fans that close its openings, each over a vertex of its own.
        wall: (u,) bool. Which of them are wall.
        cell: (u,). The cell of each triangle.
        cell_of_vertex: The cell of each vertex of the split wall, one of those that meet there.
        openings: Vertices of each open rim, longest first.
        opening_cells: For each opening the cells that end there.
        borders: Caps between cells.
        away_m: (n,). Mean distance of each cell's wall from the mouth, along the wall at rest.
        n: Number of cells.
    """

    def __init__(self, rest_m: Float32Array, triangles: IntArray, mouth: IntArray, edge_m: float = np.inf) -> None:
        wall = TriangleMesh(rest_m.astype(float), triangles)
        self._unsplit = _closed(wall)[1]
        self._splits: list[IntArray] = []
        while _lengths_m(wall).max() > edge_m:
            edges, finer = refine(wall.triangles, wall.n_vertices)
            self._splits.append(edges)
            wall = TriangleMesh(_split(wall.vertices_m, edges), finer)
        n_wall = wall.n_vertices
        self.openings, self.triangles = _closed(wall)
        self.wall = np.arange(len(self.triangles)) < wall.n_triangles
        away_m = surface_tree(wall, mouth).distance_m[wall.triangles].mean(axis=1)
        at_wall = _without_scraps(_bands(wall, away_m), wall)
        self.n = int(at_wall.max()) + 1
        self.away_m = np.bincount(at_wall, away_m) / np.bincount(at_wall)
        self.cell_of_vertex = np.zeros(n_wall, np.int32)
        self.cell_of_vertex[wall.triangles] = at_wall[:, None]
        closed = TriangleMesh(self.corners_m(rest_m), self.triangles)
        self.cell = _with_fans(at_wall, closed)
        self._over = self.triangles[:, 2] - n_wall  # the opening that a fan closes
        self.opening_cells = [np.unique(self.cell[self._over == opening]) for opening in range(len(self.openings))]
        self.borders = _borders(closed, self.cell)

    def corners_m(self, points_m: Float32Array | FloatArray) -> FloatArray:
        """Return the vertices of `triangles` where those of the given wall are at ``points_m`` (n, 3)."""
        corners_m = points_m.astype(float)
        for edges in self._splits:
            corners_m = _split(corners_m, edges)
        middles = [corners_m[rim].mean(axis=0) for rim in self.openings]
        return np.concatenate([corners_m, middles])

    def volumes_m3(self, corners_m: FloatArray) -> FloatArray:
        """Return the volume (n,) of each cell, by the divergence theorem."""
        volume = np.bincount(self.cell, _cones_m3(corners_m[self.triangles]), self.n).astype(float)
        for cap in self.borders:
            enclosed = _cones_m3(fan_m(corners_m, cap.edges)).sum()
            volume[cap.inner] += enclosed
            volume[cap.outer] -= enclosed
        return volume

    def wall_areas_m2(self, corners_m: FloatArray) -> FloatArray:
        """Return the area (n,) of each cell's wall."""
        areas_m2 = triangle_areas_m2(TriangleMesh(corners_m, self.triangles[self.wall]))
        of_cells: FloatArray = np.bincount(self.cell[self.wall], areas_m2, self.n).astype(float)
        return of_cells

    def contains(self, corners_m: FloatArray, places_m: FloatArray) -> BoolArray:
        """Return whether each place (k, 3) is in the lumen, so that its winding number is one."""
        n_openings = len(self.openings)
        n_unsplit = int(self._unsplit.max()) + 1 - n_openings
        unsplit_m = np.concatenate([corners_m[:n_unsplit], corners_m[len(corners_m) - n_openings :]])
        turns = [winding_number(place_m, self._unsplit, unsplit_m) for place_m in places_m]
        return np.array(turns, float) > 0.5

    def border_middles_m(self, corners_m: FloatArray) -> FloatArray:
        """Return the middle of each border (b, 3)."""
        return np.array([corners_m[cap.edges].mean(axis=(0, 1)) for cap in self.borders]).reshape(-1, 3)

    def end_middle_m(self, corners_m: FloatArray, opening: int, cell: int) -> FloatArray:
        """Return the middle (3,) of what a cell has of an opening."""
        fan = self.triangles[(self._over == opening) & (self.cell == cell)]
        middle_m: FloatArray = corners_m[fan].mean(axis=(0, 1))
        return middle_m


def _split(points_m: FloatArray, edges: IntArray) -> FloatArray:
    """Return points (n, 3) and the middles of edges (e, 2) between them, in one array."""
    return np.concatenate([points_m, points_m[edges].mean(axis=1)])


def _lengths_m(mesh: TriangleMesh) -> FloatArray:
    """Return the length of each half-edge."""
    ends = mesh.vertices_m[half_edges(mesh)]
    lengths_m: FloatArray = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return lengths_m


def fan_m(corners_m: FloatArray, edges: IntArray) -> FloatArray:
    """Return triangles (e, 3, 3) that close a surface along its boundary edges (e, 2), over their middle."""
    ends = corners_m[edges]
    middle = np.broadcast_to(ends.mean(axis=(0, 1)), (len(edges), 3))
    return np.stack([ends[:, 1], ends[:, 0], middle], axis=1)


def _closed(wall: TriangleMesh) -> tuple[list[IntArray], IntArray]:
    """Return the open rims, longest first, and the triangles with fans over them, each over a vertex of its own.

    A fan's triangle begins with its edge of the rim and ends with that vertex, which come after those of the wall.
    """
    rims = boundary_loops(wall)
    if not rims:
        raise ValueError("the wall has no open end, so that nothing flows through it")
    fans = [
        np.column_stack([np.roll(rim, -1), rim, np.full(len(rim), wall.n_vertices + opening)])
        for opening, rim in enumerate(rims)
    ]
    return rims, np.concatenate([wall.triangles, *fans]).astype(np.int32)


def _bands(wall: TriangleMesh, away_m: FloatArray) -> IntArray:
    """Return for each triangle, by its distance from the mouth, its band of equal distance, in one piece each."""
    band = (away_m / (_TRIANGLES_LONG * _lengths_m(wall).max())).astype(np.int64)
    one, other = (paired_half_edges(wall) // 3).T
    same = band[one] == band[other]
    alike = coo_array((np.ones(int(same.sum())), (one[same], other[same])), shape=2 * (wall.n_triangles,))
    piece: IntArray = connected_components(alike, directed=False)[1].astype(np.int32)
    return piece


def _without_scraps(cell: IntArray, wall: TriangleMesh) -> IntArray:
    """Return the cells with those taken in that have one neighbour, and less than half of its wall.

    At the far end of a tube a last band holds what is left of its length, at worst triangles one by one.
    """
    area_m2 = np.bincount(cell, triangle_areas_m2(wall))
    pairs = np.unique(np.sort(cell[paired_half_edges(wall) // 3], axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    both = np.concatenate([pairs, pairs[:, ::-1]])
    only = np.bincount(both[:, 0], minlength=len(area_m2)) == 1
    taken_in = np.arange(len(area_m2))
    small = both[only[both[:, 0]] & (area_m2[both[:, 0]] < 0.5 * area_m2[both[:, 1]])]
    taken_in[small[:, 0]] = small[:, 1]
    number: IntArray = np.unique(taken_in[cell], return_inverse=True)[1].ravel().astype(np.int32)
    return number


def _with_fans(at_wall: IntArray, closed: TriangleMesh) -> IntArray:
    """Return the cell of each triangle of a closed surface; those of fans have that of the wall at their rim."""
    cell = np.full(closed.n_triangles, -1, np.int32)
    cell[: len(at_wall)] = at_wall
    low, high = np.sort(paired_half_edges(closed) // 3, axis=1).T
    at_rim = (low < len(at_wall)) & (high >= len(at_wall))
    cell[high[at_rim]] = cell[low[at_rim]]
    return cell


def _borders(closed: TriangleMesh, cell: IntArray) -> list[Cap]:
    """Return the caps between cells of a closed surface."""
    pairs = paired_half_edges(closed)
    cells = cell[pairs // 3]
    order = np.argsort(cells, axis=1, kind="stable")
    pairs, cells = np.take_along_axis(pairs, order, axis=1), np.take_along_axis(cells, order, axis=1)
    apart = cells[:, 0] != cells[:, 1]
    edges = half_edges(closed)[pairs[apart, 0]]
    between, border = np.unique(cells[apart], axis=0, return_inverse=True)
    return [Cap(edges[border.ravel() == k], int(inner), int(outer)) for k, (inner, outer) in enumerate(between)]


def _cones_m3(corners_m: FloatArray) -> FloatArray:
    """Return the signed volume between the origin and each triangle (t, 3, 3)."""
    volume: FloatArray = np.linalg.det(corners_m) / 6.0
    return volume
