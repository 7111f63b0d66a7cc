"""A duct's lumen in cells along its way, by the triangles of its wall: closed volumes that share their borders.

Cells are made once, at rest, of triangles whose distance from the mouth is alike and that hang together, so that a fork
has cells of its own on each branch. A border between two cells is a fan over the loop of edges that they share. As the
same fan closes both, volumes add up to the lumen's, whatever the wall does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.visualization.thick_wall import boundary, refine

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
        openings: Vertices of each open rim, longest first.
        opening_cells: For each opening the cells that end there.
        borders: Caps between cells.
        n: Number of cells.
    """

    def __init__(self, rest_m: Float32Array, triangles: IntArray, mouth: IntArray, edge_m: float = np.inf) -> None:
        self._unsplit = np.concatenate([triangles, *_fans(triangles, len(rest_m))[1]])
        self._splits: list[IntArray] = []
        corners_m = rest_m.astype(float)
        while _longest_m(corners_m, triangles) > edge_m:
            edges, triangles = refine(triangles, len(corners_m))
            self._splits.append(edges)
            corners_m = _split(corners_m, edges)
        self._n_wall = len(corners_m)
        self.openings, fans = _fans(triangles, self._n_wall)
        self.triangles = np.concatenate([triangles, *fans]).astype(np.int32)
        self.wall = np.arange(len(self.triangles)) < len(triangles)
        at_wall = _without_scraps(_components(_bins(corners_m, triangles, mouth), triangles), corners_m, triangles)
        self.n = int(at_wall.max()) + 1
        inner = _cell_at_edge(triangles, at_wall)
        at_fans = [np.array([inner[int(b), int(a)] for a, b in fan[:, :2]], np.int64) for fan in fans]
        self.cell = np.concatenate([at_wall, *at_fans])
        self.opening_cells = [np.unique(cells) for cells in at_fans]
        self._cell_of_vertex = np.zeros(self._n_wall, np.int64)
        self._cell_of_vertex[triangles] = at_wall[:, None]
        self.borders = _borders(self.triangles, self.cell)

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
        a, b, c = np.moveaxis(corners_m[self.triangles[self.wall]], 1, 0)
        areas_m2 = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        of_cells: FloatArray = np.bincount(self.cell[self.wall], areas_m2, self.n).astype(float)
        return of_cells

    def cells_at(self, corners_m: FloatArray, places_m: FloatArray) -> IntArray:
        """Return the cell of each place (k, 3), or -1 where it is outside, so that the winding number is not one."""
        n_openings = len(self.openings)
        n_unsplit = int(self._unsplit.max()) + 1 - n_openings
        unsplit_m = np.concatenate([corners_m[:n_unsplit], corners_m[len(corners_m) - n_openings :]])
        turns = _solid_angles(unsplit_m[self._unsplit], places_m).sum(axis=1) / (4.0 * np.pi)
        return np.where(turns > 0.5, self.nearest_cells(corners_m, places_m), -1)

    def nearest_cells(self, corners_m: FloatArray, places_m: FloatArray) -> IntArray:
        """Return the cell whose wall is nearest to each place (k, 3)."""
        _, nearest = KDTree(corners_m[: self._n_wall]).query(places_m)
        cells: IntArray = self._cell_of_vertex[nearest].astype(np.int32)
        return cells

    def border_middles_m(self, corners_m: FloatArray) -> FloatArray:
        """Return the middle of each border (b, 3)."""
        return np.array([corners_m[cap.edges].mean(axis=(0, 1)) for cap in self.borders]).reshape(-1, 3)


def _split(points_m: FloatArray, edges: IntArray) -> FloatArray:
    """Return points (n, 3) and the middles of edges (e, 2) between them, in one array."""
    return np.concatenate([points_m, points_m[edges].mean(axis=1)])


def _longest_m(points_m: FloatArray, triangles: IntArray) -> float:
    corners = points_m[triangles]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())


def fan_m(corners_m: FloatArray, edges: IntArray) -> FloatArray:
    """Return triangles (e, 3, 3) that close a surface along its boundary edges (e, 2), over their middle."""
    ends = corners_m[edges]
    middle = np.broadcast_to(ends.mean(axis=(0, 1)), (len(edges), 3))
    return np.stack([ends[:, 1], ends[:, 0], middle], axis=1)


def _fans(triangles: IntArray, n_points: int) -> tuple[list[IntArray], list[IntArray]]:
    """Return the vertices of each open rim, and the fan that closes it over a vertex of its own from n_points on."""
    edges = boundary(triangles)
    if not len(edges):
        raise ValueError("the wall has no open end, so that nothing flows through it")
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n_points, n_points))
    _, label = connected_components(graph, directed=False)
    rims, counts = np.unique(label[edges[:, 0]], return_counts=True)
    loops = [edges[label[edges[:, 0]] == rim] for rim in rims[np.argsort(-counts, kind="stable")]]
    fans = [np.column_stack([loop[:, 1], loop[:, 0], np.full(len(loop), n_points + k)]) for k, loop in enumerate(loops)]
    return [np.unique(loop) for loop in loops], fans


def _bins(rest_m: FloatArray, triangles: IntArray, mouth: IntArray) -> IntArray:
    """Return for each triangle how many lengths of a cell it is away from the mouth, along the wall."""
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    length_m = np.linalg.norm(rest_m[ends[:, 0]] - rest_m[ends[:, 1]], axis=1)
    ways, index = np.unique(np.sort(ends, axis=1), axis=0, return_index=True)
    graph = coo_array((length_m[index], (ways[:, 0], ways[:, 1])), shape=2 * (len(rest_m),)).tocsr()
    away_m = dijkstra(graph, directed=False, indices=mouth, min_only=True)
    of_triangle = away_m[triangles].mean(axis=1)
    bins: IntArray = (of_triangle / (_TRIANGLES_LONG * float(length_m.max()))).astype(np.int64)
    return bins


def _components(bins: IntArray, triangles: IntArray) -> IntArray:
    """Return for each triangle its cell: those of one bin that hang together by edges."""
    left, right = _neighbours(triangles)
    same = bins[left] == bins[right]
    graph = coo_array((np.ones(int(same.sum())), (left[same], right[same])), shape=2 * (len(triangles),))
    label: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    return label


def _without_scraps(cell: IntArray, rest_m: FloatArray, triangles: IntArray) -> IntArray:
    """Return the cells with those taken in that have one neighbour, and less than half of its wall.

    At the far end of a tube a last bin holds what is left of its length, at worst triangles one by one.
    """
    a, b, c = np.moveaxis(rest_m[triangles], 1, 0)
    area_m2 = np.bincount(cell, np.linalg.norm(np.cross(b - a, c - a), axis=1))
    left, right = _neighbours(triangles)
    pairs = np.unique(np.sort(np.stack([cell[left], cell[right]], axis=1), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    both = np.concatenate([pairs, pairs[:, ::-1]])
    only = np.bincount(both[:, 0], minlength=len(area_m2)) == 1
    taken_in = np.arange(len(area_m2), dtype=np.int64)
    small = both[only[both[:, 0]] & (area_m2[both[:, 0]] < 0.5 * area_m2[both[:, 1]])]
    taken_in[small[:, 0]] = small[:, 1]
    number: IntArray = np.unique(taken_in[cell], return_inverse=True)[1].ravel().astype(np.int64)
    return number


def _neighbours(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Return the pairs of triangles that share an edge, as two arrays."""
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    owner = np.tile(np.arange(len(triangles)), 3)
    _, place = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    order = np.argsort(place.ravel(), kind="stable")
    sorted_place, sorted_owner = place.ravel()[order], owner[order]
    twice = sorted_place[1:] == sorted_place[:-1]
    return sorted_owner[:-1][twice], sorted_owner[1:][twice]


def _cell_at_edge(triangles: IntArray, cell: IntArray) -> dict[tuple[int, int], int]:
    """Return the cell of the triangle that runs along each directed edge."""
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).tolist()
    return {(a, b): int(of) for (a, b), of in zip(ends, np.tile(cell, 3).tolist(), strict=True)}


def _borders(triangles: IntArray, cell: IntArray) -> list[Cap]:
    """Return the caps between cells of a closed surface."""
    at_edge = _cell_at_edge(triangles, cell)
    shared: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for (a, b), inner in at_edge.items():
        outer = at_edge[b, a]
        if inner < outer:
            shared.setdefault((inner, outer), []).append((a, b))
    return [Cap(np.array(edges), *pair) for pair, edges in sorted(shared.items())]


def _cones_m3(corners_m: FloatArray) -> FloatArray:
    """Return the signed volume between the origin and each triangle (t, 3, 3)."""
    a, b, c = np.moveaxis(corners_m, 1, 0)
    volume: FloatArray = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    return volume


def _solid_angles(corners_m: FloatArray, places_m: FloatArray) -> FloatArray:
    """Return the signed solid angle of each triangle (t, 3, 3) seen from each place (k, 3), after Van Oosterom 1983."""
    a, b, c = (corners_m[None, :, i] - places_m[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    up = np.einsum("kti,kti->kt", a, np.cross(b, c))
    down = la * lb * lc
    for one, two, other in ((a, b, lc), (b, c, la), (c, a, lb)):
        down += np.einsum("kti,kti->kt", one, two) * other
    angle: FloatArray = 2.0 * np.arctan2(up, down)
    return angle
