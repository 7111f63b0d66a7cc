"""The deforming duct wall as collision detection sees it: topology and trees built once, nodes placed on demand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.bounds import LinearBounds, MotionBounds, TurnedBounds
from services.mechanics.collision.primitives import vector
from services.mechanics.collision.tick import take_state
from services.mechanics.collision.topology import (
    NO_NEIGHBOUR,
    fill_rim,
    rim_vertices,
    triangle_neighbours,
    triangles_round_vertices,
)
from services.mechanics.collision.tree import MAX_DEPTH, build_tree
from services.mechanics.collision.turned import note_turns, turn_into_place, turned_arrays
from services.mechanics.compiled import (
    Struct,
    fill,
    floats,
    ints,
    kernel,
    longs,
    nest,
    struct_reader,
    struct_type,
    summing_kernel,
)
from services.mechanics.compiled.vectors import Vector
from services.mechanics.reduction.large_rotations.warping import SectionFrame, TubeWarp
from services.mechanics.surface.mesh import TriangleMesh, boundary_loops

Body = Struct
"""The deformation, shared by the patches of one surface; see `BODY`."""
Patch = Struct
"""Triangles to search, with topology and tree: the wall itself, or the caps of its openings; see `PATCH`."""
Shell = Struct
"""body, wall, caps and rims: what a detector's kernel needs of a surface."""

BODY = struct_type(
    arrays=(
        "rest",  # (n, 3) undeformed positions
        "Phi",  # (n, 3, r) modes; turned walls: what is left of them without the sections' rigid motion
        "omega",  # (r,) weights of the displacement bound
        "q",  # (r,) modal coordinates of this tick
        "anchor",  # (r,) those from which the travel is counted, see `tick`
        "residual",  # (n, 3) displacement beyond the modes, zero but at loaded nodes
        "loaded",  # (n,) int32 loaded nodes, the first n_loaded count
        "load_stamp",  # (n,) int64 last tick in which a node was loaded
        "position",  # (n, 3) deformed positions, valid where the stamp is this tick's
        "stamp",  # (n,) int64
        "arm",  # turned walls: (n, 3) from the axis
        "segment",  # (n,) int32 between which stations of the axis
        "fraction",  # (n,) how far between
        "turn",  # (s, 3) rotation vectors of the stations in this tick
        "centre",  # (s, 3) and where they are
        "last_turn",  # the same in the last tick
        "last_centre",
        "rest_centre",
    ),
    numbers=(
        "norm",  # E = |omega q|
        "growth",  # beta: see `bounds`; 0 on a straight wall
        "largest_arm",  # turned walls: of the nodes from the axis
        "energy_norm",  # E (1 + beta E)^2, what reach and spread multiply
        "largest_residual",
        "anchor_norm",  # E there
        "anchor_travel",  # energy travel up to there
        "energy_travel",  # changes of E, grown alike; less what was noted it bounds the change since
        "energy_noted",  # what is to be noted of it in this tick
        "residual_travel",  # sum of the largest changes of a residual
        "turned_shift",  # turned walls: how far the sections' motion has carried any node from rest
        "turned_travel",  # and the sum of that of each tick
        "travel",  # the same of how far any node has moved
        "travel_noted",
        "largest_reach",  # of the wall's tree
    ),
    counts=(
        "n_nodes",
        "n_modes",
        "n_stations",
        "n_loaded",
        "tick",
        "triangle_tests",
        "tree_visits",
        "nodes_placed",
        "searches",
    ),
)
PATCH = struct_type(
    arrays=(
        "triangles",  # (m, 3)
        "neighbour",  # (m, 3) triangle across edge k -> k + 1
        "ring_start",  # (n + 1,)
        "ring",  # (3 m,) triangles round each vertex
        "on_rim",  # (n,) int8
        "box",  # and the rest of a BoundingTree
        "child",
        "span",
        "order",
        "representative",
        "reach",
        "spread",
        "seen_box",  # (k, 6) bounds of the deformed triangles when they were last looked at
        "seen_slab",  # (k, 5) normal, lowest and highest offset of a leaf along it, at the same moment
        "seen_at",  # (k, 3) the representative vertex then
        "seen_energy",  # (k,) the surface's energy travel then; -inf if never
        "seen_residual",  # (k,) its residual travel then
        "seen_turned",  # (k,) and that of its sections
        "stack",  # (MAX_DEPTH,) nodes still to visit
        "bound",  # (MAX_DEPTH,) their distances
    )
)
RIMS = struct_type(arrays=("owner",))  # (e,) int32: 3 * wall triangle + edge
SHELL = nest(body=BODY, wall=PATCH, caps=PATCH, rims=PATCH, rim_edges=RIMS)
shell_at = struct_reader(SHELL)


@dataclass(frozen=True)
class SearchCost:
    """Work done since the surface was made."""

    triangle_tests: int
    tree_visits: int
    nodes_placed: int
    searches: int


class DuctSurface:
    """Mid-surface of a duct wall moved by modal coordinates and by residual displacements at loaded nodes.

    No node is placed before a query needs it, and none twice in a tick. Not for two threads at once, and not to
    be copied: its kernels hold addresses.

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
    warp : TubeWarp, optional
        Turns the cross-sections; residual displacements then ride along with them.

    Raises
    ------
    ValueError
        Shapes that do not fit, a frequency that is not positive, a negative thickness, or rims that meet.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        Phi: FloatArray,
        omega_rad_s: FloatArray,
        half_thickness_m: float,
        warp: TubeWarp | None = None,
    ) -> None:
        n = mesh.n_vertices
        if Phi.shape[:2] != (n, 3) or omega_rad_s.shape != Phi.shape[2:]:
            raise ValueError(f"modes of shape {Phi.shape} do not fit {n} vertices and {len(omega_rad_s)} frequencies")
        if not (omega_rad_s > 0.0).all():
            raise ValueError("omega_rad_s must be positive")
        if not half_thickness_m >= 0.0:
            raise ValueError(f"half_thickness_m must not be negative, got {half_thickness_m}")
        self.mesh = mesh
        self.half_thickness_m = half_thickness_m
        self._n_modes = len(omega_rad_s)
        self.rims = boundary_loops(mesh)
        self._storage = np.zeros(1, SHELL)
        self.shell: Shell = self._storage[0]
        self.address: int = self._storage.ctypes.data
        caps = [np.zeros((0, 3), np.int32), *(fill_rim(mesh.vertices_m, rim) for rim in self.rims)]
        self._frame = None if warp is None else SectionFrame(warp)
        bounds: MotionBounds = LinearBounds(Phi / omega_rad_s) if warp is None else TurnedBounds(warp, omega_rad_s)
        body, wall = _body_arrays(mesh, Phi, omega_rad_s), _patch_arrays(mesh, mesh.triangles, bounds)
        lids = _patch_arrays(mesh, np.concatenate(caps), bounds)
        owner = np.flatnonzero(wall["neighbour"].ravel() == NO_NEIGHBOUR).astype(np.int32)
        rims = _patch_arrays(mesh, _edges_as_triangles(mesh, owner), bounds)
        self._alive = (body, wall, lids, rims, owner)
        fill(
            self.shell["body"],
            n_nodes=mesh.n_vertices,
            n_modes=self._n_modes,
            largest_reach=float(wall["reach"][0]),
            growth=bounds.growth,
            **body,
        )
        if warp is not None and self._frame is not None:
            self._turned = turned_arrays(warp, self._frame)
            arm_m = float(np.linalg.norm(warp.arm_m, axis=1).max())
            fill(self.shell["body"], n_stations=warp.sections.n_stations, largest_arm=arm_m, **self._turned)
        fill(self.shell["wall"], **wall)
        fill(self.shell["caps"], **lids)
        fill(self.shell["rims"], **rims)
        fill(self.shell["rim_edges"], owner=owner)

    def update(
        self, q: FloatArray, load_nodes: IntArray | None = None, load_displacements_m: FloatArray | None = None
    ) -> None:
        """Start a tick: modal coordinates (r,), and residual displacements (l, 3) at ``load_nodes`` (l,).

        A node may be named once; the residuals of the previous tick are forgotten. They are along undeformed axes.

        Raises
        ------
        ValueError
            Shapes that do not fit, a node that does not exist, a coordinate or displacement that is not
            finite; the surface stays as it was.
        """
        nodes = _NO_NODES if load_nodes is None else load_nodes
        residuals = _NO_VECTORS if load_displacements_m is None else load_displacements_m
        if len(q) != self._n_modes or residuals.shape != (len(nodes), 3) or len(nodes) > self.mesh.n_vertices:
            raise ValueError(
                f"{len(q)} modal coordinates and {residuals.shape} displacements of {len(nodes)} nodes do not fit"
                f" {self._n_modes} modes and {self.mesh.n_vertices} nodes"
            )
        if not _start_tick(self.address, q, nodes, residuals):
            raise ValueError("coordinates and displacements must be finite and loaded nodes exist")
        if self._frame is not None:
            self._frame.update(q)
            _end_turn(self.address)

    def node_positions(self, nodes: IntArray, out: FloatArray) -> None:
        """Write the deformed positions of ``nodes`` (k,) into ``out`` (k, 3), in m."""
        _place_nodes(self.address, nodes, out)

    @property
    def cost(self) -> SearchCost:
        """Work done so far."""
        body = self.shell["body"]
        return SearchCost(*(int(body[name]) for name in SearchCost.__dataclass_fields__))


_NO_NODES = np.zeros(0, np.int32)
_NO_VECTORS = np.zeros((0, 3))


def _edges_as_triangles(mesh: TriangleMesh, owner: IntArray) -> IntArray:
    """(e, 3) rim edges as triangles without area, so that one search serves both."""
    start = mesh.triangles[owner // 3, owner % 3]
    end = mesh.triangles[owner // 3, (owner + 1) % 3]
    return np.stack([start, end, end], axis=1).astype(np.int32)


def _body_arrays(mesh: TriangleMesh, Phi: FloatArray, omega: FloatArray) -> dict[str, np.ndarray]:
    n = mesh.n_vertices
    return {
        "rest": mesh.vertices_m,
        "Phi": np.ascontiguousarray(Phi, np.float64),
        "omega": np.ascontiguousarray(omega, np.float64),
        "q": np.zeros(len(omega)),
        "anchor": np.zeros(len(omega)),
        "residual": np.zeros((n, 3)),
        "loaded": np.zeros(n, np.int32),
        "load_stamp": np.full(n, -1, np.int64),
        "position": mesh.vertices_m.copy(),
        "stamp": np.full(n, -1, np.int64),
    }


def _patch_arrays(mesh: TriangleMesh, triangles: IntArray, bounds: MotionBounds) -> dict[str, np.ndarray]:
    n = mesh.n_vertices
    neighbour = triangle_neighbours(triangles)
    ring_start, ring = triangles_round_vertices(triangles, n)
    tree = build_tree(mesh.vertices_m, triangles, bounds)
    return {
        "triangles": np.ascontiguousarray(triangles),
        "neighbour": neighbour,
        "ring_start": ring_start,
        "ring": ring,
        "on_rim": rim_vertices(triangles, neighbour, n),
        **tree._asdict(),
        "seen_box": tree.box.copy(),
        "seen_slab": np.zeros((len(tree.box), 5)),
        "seen_at": np.zeros((len(tree.box), 3)),
        "seen_energy": np.full(len(tree.box), -np.inf),
        "seen_residual": np.zeros(len(tree.box)),
        "seen_turned": np.zeros(len(tree.box)),
        "stack": np.zeros(MAX_DEPTH, np.int32),
        "bound": np.zeros(MAX_DEPTH),
    }


@kernel
def _start_tick(shell_address: int, q: FloatArray, nodes: IntArray, residuals: FloatArray) -> bool:
    return take_state(shell_at(shell_address).body, q, nodes, residuals)


@kernel
def _end_turn(shell_address: int) -> None:
    note_turns(shell_at(shell_address).body)


@kernel
def node_position(body: Body, node: int) -> Vector:
    """Return the deformed position of a node, computing it at most once a tick."""
    stamp, position = longs(body.stamp), floats(body.position)
    if stamp[node] != body.tick:
        stamp[node] = body.tick
        body.nodes_placed += 1
        if body.n_stations == 0:
            _place(body, node, body.rest)
        else:
            _place(body, node, body.arm)
            turn_into_place(body, node)
    return vector(position, node)


@summing_kernel
def _place(body: Body, node: int, rest_address: int) -> None:
    """Evaluate rest + Phi q + residual."""
    q, r = floats(body.q), body.n_modes
    rest, residual, position = floats(rest_address), floats(body.residual), floats(body.position)
    for row in range(3 * node, 3 * node + 3):
        Phi, modal = floats(body.Phi + 8 * r * row), 0.0
        for k in range(r):
            modal += Phi[k] * q[k]
        position[row] = rest[row] + modal + residual[row]


@kernel
def corner_positions(body: Body, patch: Patch, triangle: int) -> tuple[Vector, Vector, Vector]:
    """Return the deformed corners of a triangle."""
    corner = ints(patch.triangles)
    return (
        node_position(body, corner[3 * triangle]),
        node_position(body, corner[3 * triangle + 1]),
        node_position(body, corner[3 * triangle + 2]),
    )


@kernel
def _place_nodes(shell_address: int, nodes: IntArray, out: FloatArray) -> None:
    body = shell_at(shell_address).body
    for k in range(nodes.shape[0]):
        p = node_position(body, nodes[k])
        out[k, 0], out[k, 1], out[k, 2] = p[0], p[1], p[2]
