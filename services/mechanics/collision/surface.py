"""The deforming duct wall as collision detection sees it: topology and trees built once, nodes placed on demand."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.aabb_tree import AabbTree, build_tree
from services.mechanics.collision.boxes import REACH, REGION, box_rows
from services.mechanics.collision.kept import Kept
from services.mechanics.collision.motion_bounds import LinearBounds, MotionBounds, TurnedBounds
from services.mechanics.collision.nodes import place_nodes
from services.mechanics.collision.regions import build_regions, no_regions
from services.mechanics.collision.shell import Body, Patch, Shell
from services.mechanics.collision.tick import end_turn, start_tick
from services.mechanics.collision.topology import (
    NO_NEIGHBOUR,
    fill_rim,
    rim_vertices,
    triangle_neighbours,
    triangles_round_vertices,
)
from services.mechanics.reduction.large_rotations.warping import SectionFrame, TubeWarp
from services.mechanics.surface.mesh import TriangleMesh, boundary_loops


@dataclass(frozen=True)
class SearchCost:
    """Work done since the surface was made."""

    triangle_tests: int
    tree_visits: int
    nodes_placed: int
    searches: int


class CollisionSurface:
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
        self.n_modes = len(omega_rad_s)
        self.rims = boundary_loops(mesh)
        caps = [np.zeros((0, 3), np.int32), *(fill_rim(mesh.vertices_m, rim) for rim in self.rims)]
        self._frame = None if warp is None else SectionFrame(warp)
        bounds: MotionBounds = LinearBounds(Phi / omega_rad_s) if warp is None else TurnedBounds(warp, omega_rad_s)
        wall, tree = _patch(mesh, mesh.triangles, bounds)
        owner = np.flatnonzero(wall.neighbour.ravel() == NO_NEIGHBOUR).astype(np.int32)
        if warp is None and self.n_modes:
            regions, roots = build_regions(mesh.vertices_m, mesh.triangles, tree, Phi, omega_rad_s)
            wall.boxes[roots, REGION] = np.arange(len(roots))
        else:
            regions = no_regions(n, self.n_modes)
        reach = float(wall.boxes[0, REACH])
        own = {"regions": regions, "largest_reach": reach, "growth": bounds.growth}
        own |= _blocks(Phi, omega_rad_s, None if warp is None else reach)
        self.shell = Shell(
            body=_body(mesh, Phi, omega_rad_s, own | _turned_fields(warp, self._frame)),
            wall=wall,
            caps=_patch(mesh, np.concatenate(caps), bounds)[0],
            rims=_patch(mesh, _edges_as_triangles(mesh, owner), bounds)[0],
            rim_owner=owner,
        )

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
        if len(q) != self.n_modes or residuals.shape != (len(nodes), 3) or len(nodes) > self.mesh.n_vertices:
            raise ValueError(
                f"{len(q)} modal coordinates and {residuals.shape} displacements of {len(nodes)} nodes do not fit"
                f" {self.n_modes} modes and {self.mesh.n_vertices} nodes"
            )
        if not start_tick(self.shell.address, q, nodes, residuals):
            raise ValueError("coordinates and displacements must be finite and loaded nodes exist")
        if self._frame is not None:
            self._frame.update(q)
            end_turn(self.shell.address)

    def node_positions(self, nodes: IntArray, out: FloatArray) -> None:
        """Write the deformed positions of ``nodes`` (k,) into ``out`` (k, 3), in m."""
        place_nodes(self.shell.address, nodes, out)

    @property
    def cost(self) -> SearchCost:
        """Work done so far."""
        return SearchCost(*(getattr(self.shell.body, name) for name in SearchCost.__dataclass_fields__))


#: Bounds of their own for modes side by side.
_BLOCKS = 8
_NO_NODES = np.zeros(0, np.int32)
_NO_VECTORS = np.zeros((0, 3))


def _edges_as_triangles(mesh: TriangleMesh, owner: IntArray) -> IntArray:
    """(e, 3) rim edges as triangles without area, so that one search serves both."""
    start = mesh.triangles[owner // 3, owner % 3]
    end = mesh.triangles[owner // 3, (owner + 1) % 3]
    return np.stack([start, end, end], axis=1).astype(np.int32)


def _body(mesh: TriangleMesh, Phi: FloatArray, omega: FloatArray, more: dict[str, Any]) -> Body:
    n, r = mesh.n_vertices, len(omega)
    given = {"Phi": np.ascontiguousarray(Phi, np.float64)} | more
    return Body.zeros(
        n=n,
        r=r,
        t=len(given.get("arm", ())),
        s=len(given.get("centre", ())),
        rest=mesh.vertices_m,
        omega=np.ascontiguousarray(omega, np.float64),
        load_stamp=np.full(n, -1, np.int64),
        position=mesh.vertices_m.copy(),
        stamp=np.full(n, -1, np.int64),
        **given,
    )


def _blocks(Phi: FloatArray, omega: FloatArray, reach: float | None) -> dict[str, Any]:
    """Bound the motion of any node by blocks of modes, small ones where modes are soft; or by ``reach`` for all."""
    r = len(omega)
    edges = np.unique(np.round(r * np.linspace(0.0, 1.0, _BLOCKS + 1) ** 1.5).astype(np.int32))
    if reach is not None:
        return {"block": np.array([0, r], np.int32), "block_reach": np.array([reach])}
    every = np.arange(len(Phi), dtype=np.int32)
    reaches = [LinearBounds(Phi[:, :, a:b] / omega[a:b]).reach(every).max() for a, b in itertools.pairwise(edges)]
    return {"block": edges, "block_reach": np.array(reaches)}


def _turned_fields(warp: TubeWarp | None, frame: SectionFrame | None) -> dict[str, Any]:
    """What a `Body` has besides where cross-sections turn; turns and centres are those that ``frame`` updates."""
    if warp is None or frame is None:
        return {}
    return {
        "Phi": warp.local,
        "arm": warp.arm_m,
        "segment": warp.sections.segment,
        "fraction": warp.sections.fraction,
        "turn": frame.turns,
        "centre": frame.centres_m,
        "last_turn": frame.turns.copy(),
        "last_centre": frame.centres_m.copy(),
        "rest_centre": warp.sections.centres_m,
        "largest_arm": float(np.linalg.norm(warp.arm_m, axis=1).max()),
    }


#: Of the three patches of a surface.
_tree = Kept(build_tree, 3)


def _patch(mesh: TriangleMesh, triangles: IntArray, bounds: MotionBounds) -> tuple[Patch, AabbTree]:
    n = mesh.n_vertices
    neighbour = triangle_neighbours(triangles)
    ring_start, ring = triangles_round_vertices(triangles, n)
    tree = _tree(mesh.vertices_m, triangles, bounds)
    patch = Patch.zeros(
        triangles=np.ascontiguousarray(triangles),
        neighbour=neighbour,
        ring_start=ring_start,
        ring=ring,
        on_rim=rim_vertices(triangles, neighbour, n),
        span=tree.span,
        order=tree.order,
        boxes=box_rows(tree),
    )
    return patch, tree
