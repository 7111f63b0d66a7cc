"""The deforming duct wall as collision detection sees it: topology and trees built once, nodes placed on demand."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from services.mechanics.collision.kernel import inlined, kernel
from services.mechanics.collision.primitives import Vector
from services.mechanics.collision.topology import (
    fill_rim,
    rim_vertices,
    triangle_neighbours,
    triangles_round_vertices,
)
from services.mechanics.collision.tree import BoundingTree, build_tree
from services.mechanics.mesh import FloatArray, IntArray, TriangleMesh, boundary_loops

# Entries of Body.measure.
ENERGY_NORM, LARGEST_RESIDUAL, TRAVEL, LARGEST_REACH = 0, 1, 2, 3
# Entries of Body.count: work done since the start, for those who ask what a mesh costs.
TRIANGLE_TESTS, TREE_VISITS, NODES_PLACED, SEARCHES = 0, 1, 2, 3


class Body(NamedTuple):
    """Deformation of the wall, shared by all the patches of one surface; arrays only, for the kernels."""

    rest: FloatArray
    """(n, 3) undeformed positions."""
    Phi: FloatArray
    """(n, 3, r) modes."""
    omega: FloatArray
    """(r,) weights of the displacement bound."""
    q: FloatArray
    """(r,) modal coordinates of this tick."""
    residual: FloatArray
    """(n, 3) displacement beyond the modes, zero but at loaded nodes."""
    loaded: IntArray
    """(1 + n,) number of loaded nodes, then their indices."""
    load_stamp: npt.NDArray[np.int64]
    """(n,) last tick in which a node was loaded."""
    position: FloatArray
    """(n, 3) deformed positions, valid where ``stamp`` equals the tick."""
    stamp: npt.NDArray[np.int64]
    """(n + 1,) tick of each position; the last entry is the tick itself."""
    measure: FloatArray
    """(4,) |omega q|, largest residual, bound of how far any node has travelled since the start, and the
    largest ``reach`` of the wall's tree."""
    count: npt.NDArray[np.int64]
    """(4,) triangle tests, tree visits, nodes placed, full searches."""


class Patch(NamedTuple):
    """Triangles to search, with their topology and tree: the wall itself, or the caps of its openings."""

    triangles: IntArray
    neighbour: IntArray
    ring_start: IntArray
    ring: IntArray
    on_rim: npt.NDArray[np.int8]
    tree: BoundingTree
    stack: IntArray
    bound: FloatArray


class Shell(NamedTuple):
    """What a detector's kernel needs of a surface."""

    body: Body
    wall: Patch
    caps: Patch


class DuctSurface:
    """Mid-surface of a duct wall moved by modal coordinates and by residual displacements at loaded nodes.

    No node is placed before a query needs it, and none twice in a tick. Not for two threads at once.

    Parameters
    ----------
    mesh : TriangleMesh
        Undeformed mid-surface, wound with the normals away from the lumen; any topology.
    Phi : (n, 3, r) float64
        Modes; r = 0 makes a rigid surface.
    omega_rad_s : (r,) float64
        Circular frequencies. They weigh the displacement bound of the search tree: any positive numbers give
        right answers, these give fast ones.
    half_thickness_m : float
        Distance from the mid-surface to either face of the wall.
    """

    def __init__(
        self, mesh: TriangleMesh, Phi: FloatArray, omega_rad_s: FloatArray, half_thickness_m: float
    ) -> None:
        n = mesh.n_vertices
        if Phi.shape[:2] != (n, 3) or omega_rad_s.shape != Phi.shape[2:]:
            raise ValueError(
                f"modes of shape {Phi.shape} do not fit {n} vertices and {len(omega_rad_s)} frequencies"
            )
        if (omega_rad_s <= 0.0).any():
            raise ValueError("omega_rad_s must be positive")
        if half_thickness_m < 0.0:
            raise ValueError(f"half_thickness_m must not be negative, got {half_thickness_m}")
        self.mesh = mesh
        self.half_thickness_m = half_thickness_m
        self.rims = boundary_loops(mesh)
        body = _rest_body(mesh, Phi, omega_rad_s)
        scaled_modes = Phi / omega_rad_s
        wall = _patch(mesh.vertices_m, mesh.triangles, scaled_modes)
        caps = [np.zeros((0, 3), np.int32), *(fill_rim(mesh.vertices_m, rim) for rim in self.rims)]
        self.shell = Shell(body, wall, _patch(mesh.vertices_m, np.concatenate(caps), scaled_modes))
        body.measure[LARGEST_REACH] = wall.tree.reach[0]

    def update(
        self, q: FloatArray, load_nodes: IntArray | None = None, load_displacements_m: FloatArray | None = None
    ) -> None:
        """Start a tick: modal coordinates (r,), and residual displacements (l, 3) at ``load_nodes`` (l,).

        A node may be named once; the residuals of the previous tick are forgotten.
        """
        nodes = _NO_NODES if load_nodes is None else load_nodes
        residuals = _NO_VECTORS if load_displacements_m is None else load_displacements_m
        _start_tick(self.shell.body, q, nodes, residuals)

    def node_positions(self, nodes: IntArray, out: FloatArray) -> None:
        """Write the deformed positions of ``nodes`` (k,) into ``out`` (k, 3), in m."""
        _place_nodes(self.shell.body, nodes, out)


_NO_NODES = np.zeros(0, np.int32)
_NO_VECTORS = np.zeros((0, 3))


def _rest_body(mesh: TriangleMesh, Phi: FloatArray, omega: FloatArray) -> Body:
    n = mesh.n_vertices
    stamp = np.full(n + 1, -1, np.int64)
    stamp[n] = 0
    return Body(
        rest=mesh.vertices_m,
        Phi=np.ascontiguousarray(Phi),
        omega=np.ascontiguousarray(omega),
        q=np.zeros(len(omega)),
        residual=np.zeros((n, 3)),
        loaded=np.zeros(n + 1, np.int32),
        load_stamp=np.full(n, -1, np.int64),
        position=mesh.vertices_m.copy(),
        stamp=stamp,
        measure=np.zeros(4),
        count=np.zeros(4, np.int64),
    )


def _patch(vertices_m: FloatArray, triangles: IntArray, scaled_modes: FloatArray) -> Patch:
    neighbour = triangle_neighbours(triangles)
    start, ring = triangles_round_vertices(triangles, len(vertices_m))
    on_rim = rim_vertices(triangles, neighbour, len(vertices_m))
    tree = build_tree(vertices_m, triangles, scaled_modes)
    # A depth-first walk of a balanced binary tree holds one sibling a level.
    return Patch(triangles, neighbour, start, ring, on_rim, tree, np.zeros(64, np.int32), np.zeros(64))


@kernel
def _start_tick(body: Body, q: FloatArray, nodes: IntArray, residuals: FloatArray) -> None:
    """Take over q and the residuals; add this tick's largest possible node motion to the travel."""
    norm, change = 0.0, 0.0
    for k in range(q.shape[0]):
        norm += (body.omega[k] * q[k]) ** 2
        change += (body.omega[k] * (q[k] - body.q[k])) ** 2
        body.q[k] = q[k]
    body.stamp[-1] += 1
    body.measure[ENERGY_NORM] = math.sqrt(norm)
    travel = body.measure[LARGEST_REACH] * math.sqrt(change)
    body.measure[TRAVEL] += travel + _replace_residuals(body, nodes, residuals)


@kernel
def _replace_residuals(body: Body, nodes: IntArray, residuals: FloatArray) -> float:
    """Forget the last tick's residuals, set this tick's, return the largest change of any node's."""
    tick = body.stamp[-1]
    largest, change = 0.0, 0.0
    for k in range(nodes.shape[0]):
        body.load_stamp[nodes[k]] = tick
    for k in range(body.loaded[0]):
        node = body.loaded[1 + k]
        if body.load_stamp[node] != tick:
            old = body.residual[node]
            change = max(change, old[0] ** 2 + old[1] ** 2 + old[2] ** 2)
            for axis in range(3):
                body.residual[node, axis] = 0.0
    for k in range(nodes.shape[0]):
        old, new = body.residual[nodes[k]], residuals[k]
        change = max(change, (new[0] - old[0]) ** 2 + (new[1] - old[1]) ** 2 + (new[2] - old[2]) ** 2)
        largest = max(largest, new[0] ** 2 + new[1] ** 2 + new[2] ** 2)
        for axis in range(3):
            body.residual[nodes[k], axis] = new[axis]
        body.loaded[1 + k] = nodes[k]
    body.loaded[0] = nodes.shape[0]
    body.measure[LARGEST_RESIDUAL] = math.sqrt(largest)
    return math.sqrt(change)


@inlined
def node_position(body: Body, node: int) -> Vector:
    """Return the deformed position of a node, computing it at most once a tick."""
    if body.stamp[node] != body.stamp[-1]:
        body.stamp[node] = body.stamp[-1]
        body.count[NODES_PLACED] += 1
        _place(body.Phi, body.q, body.rest, body.residual, body.position, node)
    return (body.position[node, 0], body.position[node, 1], body.position[node, 2])


@kernel
def _place(
    Phi: FloatArray, q: FloatArray, rest: FloatArray, residual: FloatArray, position: FloatArray, node: int
) -> None:
    for axis in range(3):
        modal = _modal_sum(Phi, node, axis, q)
        position[node, axis] = rest[node, axis] + modal + residual[node, axis]


@kernel
def _modal_sum(Phi: FloatArray, node: int, axis: int, q: FloatArray) -> float:
    """Return Phi[node, axis] . q in four partial sums, which the compiler may vectorise without reordering anything."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    row = Phi[node, axis]
    fours = q.shape[0] // 4
    for k in range(fours):
        s0 += row[4 * k] * q[4 * k]
        s1 += row[4 * k + 1] * q[4 * k + 1]
        s2 += row[4 * k + 2] * q[4 * k + 2]
        s3 += row[4 * k + 3] * q[4 * k + 3]
    for k in range(4 * fours, q.shape[0]):
        s0 += row[k] * q[k]
    return (s0 + s1) + (s2 + s3)


@inlined
def corner_positions(body: Body, triangles: IntArray, triangle: int) -> tuple[Vector, Vector, Vector]:
    """Return the deformed corners of a triangle."""
    return (
        node_position(body, triangles[triangle, 0]),
        node_position(body, triangles[triangle, 1]),
        node_position(body, triangles[triangle, 2]),
    )


@kernel
def _place_nodes(body: Body, nodes: IntArray, out: FloatArray) -> None:
    for k in range(nodes.shape[0]):
        p = node_position(body, nodes[k])
        out[k, 0], out[k, 1], out[k, 2] = p[0], p[1], p[2]
