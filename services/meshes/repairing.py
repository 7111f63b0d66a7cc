"""Repairs that do not guess: what they changed is listed, what would need a guess is refused."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, triangle_areas_m2, unique_edges
from trocar.services.meshes.checking import Finding, check_surface
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.openings import enclosed_volume_m3, find_openings, open_rims
from trocar.services.meshes.winding import flipped_edges, wind_consistently

MERGE_RATIO = 1e-6
"""Vertices closer than this part of the surface's size are one vertex."""
STRAY_AREA = 0.05
"""Loose pieces with less than this part of the area are dropped; a larger one is refused."""
PINHOLE_RATIO = 0.2
"""An open rim narrower than this part of the widest is a hole in the wall, not an end, and is closed."""


@dataclass(frozen=True)
class RepairedMesh:
    """A surface without defects, wound outwards, and what was done to it."""

    mesh: TriangleMesh
    actions: list[str]


def repair_surface(mesh: TriangleMesh, is_used: bool = True, may_be_closed: bool = False) -> RepairedMesh:
    """Merge, drop, cut loose, orient and close pinholes until nothing is left to find.

    ``is_used`` says whether the triangles are used as they are; see `check_surface`. A surface without an open end is
    refused, unless it ``may_be_closed``.
    Raises MeshError if a defect remains that cannot be mended without guessing; says which and where.
    """
    actions: list[str] = []
    for step in (merge_and_drop, _keep_largest_piece, _wind_consistently):
        mesh = step(mesh, actions)
    if not may_be_closed or open_rims(mesh):
        mesh = _close_pinholes(mesh, actions)
    findings = check_surface(mesh, is_used)
    if findings:
        raise MeshError("surface cannot be repaired: " + "; ".join(map(str, findings)))
    if enclosed_volume_m3(mesh) < 0.0:
        mesh = TriangleMesh(mesh.vertices_m, mesh.triangles[:, ::-1])
        actions.append("turned all triangles to face outwards")
    return RepairedMesh(mesh, actions)


def merge_and_drop(mesh: TriangleMesh, actions: list[str]) -> TriangleMesh:
    """Make coincident vertices one, drop flat and repeated triangles; appends what it did to ``actions``."""
    import trimesh

    surface = trimesh.Trimesh(mesh.vertices_m, mesh.triangles, process=False)
    tolerance = MERGE_RATIO * float(np.linalg.norm(np.ptp(mesh.vertices_m, axis=0)))
    surface.merge_vertices(digits_vertex=int(-np.floor(np.log10(max(tolerance, 1e-300)))))
    surface.update_faces(surface.nondegenerate_faces(height=0.1 * tolerance))
    surface.update_faces(surface.unique_faces())
    surface.remove_unreferenced_vertices()
    if not len(surface.faces):
        raise MeshError("surface has no triangle with an area")
    merged, dropped = mesh.n_vertices - len(surface.vertices), mesh.n_triangles - len(surface.faces)
    if merged or dropped:
        actions.append(f"merged {merged} vertices and dropped {dropped} triangles that were flat or twice there")
    return TriangleMesh(surface.vertices, surface.faces, _moved_sets(mesh, surface.vertices, tolerance))


def _moved_sets(mesh: TriangleMesh, vertices: FloatArray, tolerance_m: float) -> dict[str, IntArray]:
    """Return the vertex sets of a mesh by the vertices that are left of it; one that is gone is in none."""
    if not mesh.vertex_sets:
        return {}
    found = cKDTree(vertices).query(mesh.vertices_m)
    near, place = np.asarray(found[0]) <= 2.0 * tolerance_m, np.asarray(found[1], np.int64)
    return {name: np.unique(place[ids[near[ids]]]).astype(np.int32) for name, ids in mesh.vertex_sets.items()}


def _keep_largest_piece(mesh: TriangleMesh, actions: list[str]) -> TriangleMesh:
    """Drop what hangs on the largest sheet by a branching edge, a single vertex, or nothing at all."""
    import trimesh

    sheets = trimesh.Trimesh(mesh.vertices_m, mesh.triangles, process=False)
    piece = trimesh.graph.connected_component_labels(sheets.face_adjacency, node_count=mesh.n_triangles)
    area = np.bincount(piece, triangle_areas_m2(mesh))
    by_size = np.argsort(-area)
    if len(area) == 1:
        return mesh
    place_mm = np.round(1e3 * mesh.vertices_m[mesh.triangles[piece == by_size[1]]].mean(axis=(0, 1)), 2).tolist()
    share = area[by_size[1]] / area.sum()
    if share > STRAY_AREA:
        raise MeshError(f"surface has a second piece round {place_mm} mm with {100 * share:.0f} % of its area")
    actions.append(f"dropped {len(area) - 1} loose pieces, the largest round {place_mm} mm")
    used, triangles = np.unique(mesh.triangles[piece == by_size[0]], return_inverse=True)
    return TriangleMesh(mesh.vertices_m[used], triangles.reshape(-1, 3).astype(np.int32))


def _wind_consistently(mesh: TriangleMesh, actions: list[str]) -> TriangleMesh:
    edges, shared = unique_edges(mesh)
    branching = edges[shared > 2]
    if len(branching):
        where = Finding(
            "edges shared by more than two triangles", len(branching), mesh.vertices_m[branching[0]].mean(axis=0)
        )
        raise MeshError(f"surface cannot be repaired: {where}")
    wound = wind_consistently(mesh, actions)
    if len(flipped_edges(wound)):
        raise MeshError("surface has one side only (it is twisted like a Möbius band), it has no lumen")
    return wound


def _close_pinholes(mesh: TriangleMesh, actions: list[str]) -> TriangleMesh:
    """Close every rim much narrower than the widest with a fan round its centre."""
    openings = find_openings(mesh)
    if not openings:
        raise MeshError(
            "surface has no open end, it cannot be a duct: if its vessels are capped, delete the triangles of two caps "
            "or more (in Blender, MeshLab or 3D Slicer), so that a rim is left at each end"
        )
    holes = [o for o in openings if o.diameter_m < PINHOLE_RATIO * openings[0].diameter_m]
    for hole in holes:
        centre = mesh.n_vertices
        fan = np.stack([np.full_like(hole.rim, centre), np.roll(hole.rim, -1), hole.rim], axis=1)
        mesh = TriangleMesh(np.vstack([mesh.vertices_m, hole.centre_m]), np.concatenate([mesh.triangles, fan]))
        place_mm = np.round(1e3 * hole.centre_m, 2).tolist()
        actions.append(f"closed a hole {1e3 * hole.diameter_m:.2g} mm wide at {place_mm} mm")
    if len(open_rims(mesh)) != len(openings) - len(holes):
        raise MeshError("holes in the wall could not be closed")
    return mesh
