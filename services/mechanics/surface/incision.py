"""A partial cut across a tube: its surface is parted along an arc, and both lips are drawn aside, as cut tissue gapes.

First the arc is made of edges. An edge that crosses it is divided there; an end of such an edge that lies near is moved
to the arc instead, along the edge (Labelle and Shewchuk, "Isosurface stuffing", SIGGRAPH 2007), so that no sliver is
left. Then the vertices within the arc are doubled, one for each lip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.surface.cross_section import CrossSection, pierced_m, section_behind_mouth
from trocar.services.mechanics.surface.mesh import TriangleMesh, edge_of_half_edges
from trocar.services.mechanics.surface.refining import refine

INCISION = "incision"
"""Name of the rim, as an opening of the duct."""
DEEPEST = 0.8
"""Share of the circumference that may be cut: with less wall left it is a thread that hangs on nothing."""
_EDGES_ALONG = 16.0
"""At least so many edges along each lip."""
_EDGES_ACROSS = 2.0
"""Edges in the width of the gap."""
_GRADING = 0.5
"""By which edges grow with their distance from the cut."""
_NEAR = 0.35
"""Share of an edge: an end so near to the arc is moved to it."""
_RECEDES = 1.5
"""Of the width of the gap: how far from it the wall is still drawn aside; its vertices keep their order."""


@dataclass(frozen=True, slots=True)
class Incision:
    """A cut: place behind the mouth, share of the circumference, width of the gap, and the side on which it is.

    See `trocar.services.mechanics.scene.incision`.
    """

    at_m: float
    depth: float
    length_m: float
    front: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class _Arc:
    """Where the cut runs: in the plane across the duct, to both sides of the front.

    Attributes:
        section: CrossSection. Where the plane lies.
        front, side: (3,) float64. Unit vectors across the duct: to the front, and across it and the duct.
        half_rad: float. Half the angle that is cut.
        ends_m: (2, 3) float64. On the surface.
    """

    section: CrossSection
    front: FloatArray
    side: FloatArray
    half_rad: float
    ends_m: FloatArray

    def along_m(self, points_m: FloatArray) -> FloatArray:
        """Return how far points (n, 3) lie beyond the plane of the cut."""
        along: FloatArray = (points_m - self.section.middle_m) @ self.section.inward
        return along

    def off_front_rad(self, points_m: FloatArray) -> FloatArray:
        """Return the angle (n,) of points (n, 3) from the front, 0 to pi; infinite for those of other parts."""
        away = points_m - self.section.middle_m
        angle = np.abs(np.arctan2(away @ self.side, away @ self.front))
        is_far = np.linalg.norm(away, axis=1) > self.section.reach_m
        found: FloatArray = np.where(is_far, np.inf, angle)
        return found

    @property
    def length_m(self) -> float:
        """Length of the cut round the duct."""
        return 2.0 * self.half_rad * self.section.radius_m


def incise(mesh: TriangleMesh, cut: Incision) -> TriangleMesh:
    """Return the surface with a cut, whose rim is the set of vertices `INCISION`, in order.

    Vertices keep their numbers and other sets stay as they are; near the cut the triangles are finer.
    Raises ValueError that begins with the key of the value with which nothing can be cut.
    """
    check_incision(cut)
    arc = _arc(mesh, cut)
    edge_m = min(cut.length_m / _EDGES_ACROSS, arc.length_m / _EDGES_ALONG)
    fine = refine(mesh, lambda points_m: edge_m + _GRADING * _distance_m(arc, points_m))
    fine = TriangleMesh(fine.vertices_m, fine.triangles, mesh.vertex_sets)
    rims = _rim_vertices(mesh)
    if len(_rim_vertices(fine)) != len(rims):
        raise ValueError(_too_near(cut))
    fine = _with_ends(fine, arc, rims, cut)
    return _gaping(*_parted(_with_arc(fine, arc, rims), arc), arc, cut, rims)


def gap_middle_m(mesh: TriangleMesh) -> FloatArray:
    """Return the point (3,) halfway between the middles of both lips of a mesh's cut."""
    rim = mesh.vertices_m[mesh.vertex_sets[INCISION]]
    lip = len(rim) // 2 - 1  # vertices of each between the ends
    first, second = np.arange(1, lip + 1), np.arange(lip + 2, 2 * lip + 2)
    middles = [rim[own[(lip - 1) // 2 : lip // 2 + 1]].mean(axis=0) for own in (first, second)]
    middle: FloatArray = np.mean(middles, axis=0)
    return middle


def check_incision(cut: Incision) -> None:
    """Check a cut's numbers, without a surface. Raises ValueError that begins with the key."""
    for key in ("at_m", "depth", "length_m"):
        if not getattr(cut, key) > 0.0:
            raise ValueError(f"{key}: must be positive, is {getattr(cut, key)}")
    if cut.depth > DEEPEST:
        raise ValueError(f"depth: at most {DEEPEST:g} of the circumference can be cut, is {cut.depth}")
    if not any(cut.front):
        raise ValueError("front: must not be zero")


def _too_near(cut: Incision) -> str:
    return f"at_m: the cut comes too near to an end of the duct, at {1e3 * cut.at_m:g} mm behind its mouth"


def _arc(mesh: TriangleMesh, cut: Incision) -> _Arc:
    try:
        section = section_behind_mouth(mesh, cut.at_m)
    except ValueError as error:
        raise ValueError(f"at_m: {error}") from None
    try:
        front = section.across(cut.front)
    except ValueError as error:
        raise ValueError(f"front: {error}") from None
    side, half_rad = np.cross(section.inward, front), math.pi * cut.depth
    ends = []
    for sign in (1.0, -1.0):
        end = pierced_m(mesh, section.middle_m, math.cos(half_rad) * front + sign * math.sin(half_rad) * side)
        if end is None:
            raise ValueError("at_m: the duct has no wall all round there, it is cut open already")
        ends.append(end.place_m)
    return _Arc(section, front, side, half_rad, np.array(ends))


def _distance_m(arc: _Arc, points_m: FloatArray) -> FloatArray:
    """Return about how far points (n, 3) are from the arc, along the surface."""
    beside = np.maximum(arc.off_front_rad(points_m) - arc.half_rad, 0.0)
    away_m = np.linalg.norm(points_m - arc.section.middle_m, axis=1)
    beside_m = np.where(np.isinf(beside), away_m, beside * arc.section.radius_m)
    distance: FloatArray = np.hypot(arc.along_m(points_m), beside_m)
    return distance


def _rim_vertices(mesh: TriangleMesh) -> IntArray:
    edges, _, counts = edge_of_half_edges(mesh)
    rims: IntArray = np.unique(edges[counts == 1])
    return rims


def _with_ends(mesh: TriangleMesh, arc: _Arc, rims: IntArray, cut: Incision) -> TriangleMesh:
    """Return the surface with the nearest vertex at each end of the arc."""
    vertices_m = mesh.vertices_m.copy()
    for end_m in arc.ends_m:
        nearest = int(np.argmin(np.linalg.norm(vertices_m - end_m, axis=1)))
        if nearest in rims:
            raise ValueError(_too_near(cut))
        vertices_m[nearest] = end_m
    return TriangleMesh(vertices_m, mesh.triangles, mesh.vertex_sets)


def _with_arc(mesh: TriangleMesh, arc: _Arc, rims: IntArray) -> TriangleMesh:
    """Return the surface with the arc made of edges."""
    mesh = _snapped(mesh, arc, rims)
    edges, of_half_edge, _ = edge_of_half_edges(mesh)
    crosses, places_m, _ = _crossings(mesh, edges, arc)
    number = np.full(len(edges), -1, np.int32)
    number[crosses] = mesh.n_vertices + np.arange(crosses.sum(), dtype=np.int32)
    vertices_m = np.concatenate([mesh.vertices_m, places_m])
    triangles = _divided(mesh.triangles, number[of_half_edge].reshape(-1, 3), vertices_m)
    return TriangleMesh(vertices_m, triangles, mesh.vertex_sets)


def _snapped(mesh: TriangleMesh, arc: _Arc, rims: IntArray) -> TriangleMesh:
    """Return the surface with the vertices near the arc on it, each moved along the edge on which that is nearest."""
    edges, _, _ = edge_of_half_edges(mesh)
    crosses, places_m, share = _crossings(mesh, edges, arc)
    vertex = np.where(share < 0.5, edges[crosses, 0], edges[crosses, 1])
    away = np.minimum(share, 1.0 - share)
    near = np.flatnonzero((away < _NEAR) & ~np.isin(vertex, rims))
    order = near[np.argsort(-away[near], kind="stable")]  # the nearest comes last, and stays
    vertices_m = mesh.vertices_m.copy()
    vertices_m[vertex[order]] = places_m[order]
    return TriangleMesh(vertices_m, mesh.triangles, mesh.vertex_sets)


def _crossings(mesh: TriangleMesh, edges: IntArray, arc: _Arc) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return which of the edges (e, 2) cross the arc, where (k, 3), and at which share of their length (k,)."""
    along_m = _along_m(mesh.vertices_m, arc)[edges]
    crosses = along_m[:, 0] * along_m[:, 1] < 0.0
    share = along_m[crosses, 0] / (along_m[crosses, 0] - along_m[crosses, 1])
    first, second = (mesh.vertices_m[edges[crosses, end]] for end in range(2))
    places_m = first + share[:, None] * (second - first)
    within = arc.off_front_rad(places_m) < arc.half_rad
    crosses[crosses] = within
    return crosses, places_m[within], share[within]


def _along_m(points_m: FloatArray, arc: _Arc) -> FloatArray:
    """Return `_Arc.along_m`, zero for what lies in the plane up to rounding."""
    along_m = arc.along_m(points_m)
    along_m[np.abs(along_m) < 1e-9 * arc.section.radius_m] = 0.0
    return along_m


def _divided(triangles: IntArray, cut: IntArray, vertices_m: FloatArray) -> IntArray:
    """Return triangles (m, 3) divided at the vertices ``cut`` (m, 3) of their edges k -> k + 1, -1 for none.

    A plane crosses two edges of a triangle, or one and the corner before it, or none. Of the four corners that two
    crossings leave the nearer ones are joined.
    """
    count = (cut >= 0).sum(axis=1)
    made = [triangles[count == 0]]
    for k in range(3):
        one = (count == 1) & (cut[:, k] >= 0)
        a, b, c = (triangles[one, (k + j) % 3] for j in range(3))
        made += [np.stack([a, cut[one, k], c], axis=1), np.stack([cut[one, k], b, c], axis=1)]
        two = (count == 2) & (cut[:, k] < 0)
        a, b, c = (triangles[two, (k + j) % 3] for j in range(3))
        bc, ca = cut[two, (k + 1) % 3], cut[two, (k + 2) % 3]
        from_a = np.linalg.norm(vertices_m[a] - vertices_m[bc], axis=1)
        is_a = from_a <= np.linalg.norm(vertices_m[b] - vertices_m[ca], axis=1)
        made.append(np.stack([c, ca, bc], axis=1))
        made.append(np.stack([a, b, np.where(is_a, bc, ca)], axis=1))
        made.append(np.stack([np.where(is_a, a, b), bc, ca], axis=1))
    return np.concatenate(made).astype(np.int32)


def _parted(mesh: TriangleMesh, arc: _Arc) -> tuple[TriangleMesh, IntArray, IntArray]:
    """Return the surface parted along the arc, and the vertices (k,) of the lip before it and of the lip beyond.

    The ends of the arc belong to both lips and are in neither.
    """
    off_rad = arc.off_front_rad(mesh.vertices_m)
    on_arc = (_along_m(mesh.vertices_m, arc) == 0.0) & (off_rad < arc.half_rad * (1.0 - 1e-9))
    before = np.flatnonzero(on_arc).astype(np.int32)
    beyond = mesh.n_vertices + np.arange(len(before), dtype=np.int32)
    number = np.arange(mesh.n_vertices, dtype=np.int32)
    number[before] = beyond
    is_beyond = _along_m(mesh.vertices_m, arc)[mesh.triangles].sum(axis=1) > 0.0
    triangles = np.where(is_beyond[:, None], number[mesh.triangles], mesh.triangles)
    vertices_m = np.concatenate([mesh.vertices_m, mesh.vertices_m[before]])
    return TriangleMesh(vertices_m, triangles, mesh.vertex_sets), before, beyond


def _gaping(
    mesh: TriangleMesh, before: IntArray, beyond: IntArray, arc: _Arc, cut: Incision, rims: IntArray
) -> TriangleMesh:
    """Return the parted surface with its lips drawn aside, less and less away from them, and their rim named."""
    along_m = _along_m(mesh.vertices_m, arc)
    share = np.minimum(arc.off_front_rad(mesh.vertices_m) / arc.half_rad, 1.0)
    aside_m = 0.5 * cut.length_m * np.cos(0.5 * math.pi * share)
    aside_m *= np.maximum(1.0 - np.abs(along_m) / (_RECEDES * cut.length_m), 0.0)
    way = np.sign(along_m)
    way[before], way[beyond] = -1.0, 1.0
    if (aside_m[rims] > 0.0).any():
        raise ValueError(_too_near(cut))
    vertices_m = mesh.vertices_m + (way * aside_m)[:, None] * arc.section.inward
    rim = _rim(mesh, arc, before, beyond)
    return TriangleMesh(vertices_m, mesh.triangles, {**mesh.vertex_sets, INCISION: rim})


def _rim(mesh: TriangleMesh, arc: _Arc, before: IntArray, beyond: IntArray) -> IntArray:
    """Return the rim in order: one end, one lip, the other end, and the other lip back."""
    ends = [int(np.argmin(np.linalg.norm(mesh.vertices_m - end_m, axis=1))) for end_m in arc.ends_m]
    away = mesh.vertices_m[before] - arc.section.middle_m
    order = np.argsort(-np.arctan2(away @ arc.side, away @ arc.front), kind="stable")
    return np.concatenate([[ends[0]], before[order], [ends[1]], beyond[order[::-1]]]).astype(np.int32)
