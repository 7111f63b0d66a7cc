"""Open ends of a duct surface: finding, measuring and naming them, and placing the duct by them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    edge_of_half_edges,
    half_edges,
)
from trocar.services.meshes.errors import MeshError


@dataclass(frozen=True)
class SurfaceOpening:
    """One open rim of a surface."""

    name: str
    """``end_0`` is the widest, then in order of width."""
    rim: IntArray
    """(k,) vertices in order round the rim."""
    centre_m: FloatArray
    direction: FloatArray
    """(3,) unit normal of the rim's mean plane, out of the lumen."""
    diameter_m: float
    """Of the circle with the rim's area."""


def open_rims(mesh: TriangleMesh) -> list[IntArray]:
    """Return the open rims, longest first, each in order along the direction of its triangles' edges.

    Raises MeshError with the place where rims touch: which is which cannot be told there.
    """
    directed = half_edges(mesh)
    _, edge, counts = edge_of_half_edges(mesh)
    leaves = np.bincount(directed[counts[edge] == 1, 0], minlength=mesh.n_vertices)
    touching = np.flatnonzero(leaves > 1)
    if len(touching):
        place_mm = np.round(1e3 * mesh.vertices_m[touching[0]], 2).tolist()
        raise MeshError(
            f"surface has open rims that touch in {len(touching)} vertices, the first at {place_mm} mm: close one of "
            "them, or leave a triangle between them"
        )
    return boundary_loops(mesh)


def find_openings(mesh: TriangleMesh) -> list[SurfaceOpening]:
    """Open rims of an outward-wound surface, widest first.

    Raises MeshError if rims touch.
    """
    measured = sorted(((rim, *_measure(mesh.vertices_m[rim])) for rim in open_rims(mesh)), key=lambda m: -m[3])
    return [SurfaceOpening(f"end_{k}", *values) for k, values in enumerate(measured)]


def _measure(points_m: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Centre, outward direction and diameter of a rim whose order is that of the wall's own edges."""
    centre = points_m.mean(axis=0)
    spokes = points_m - centre
    area_vector = -0.5 * np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0)
    area = float(np.linalg.norm(area_vector))
    return centre, area_vector / max(area, 1e-300), 2.0 * float(np.sqrt(area / np.pi))


def enclosed_volume_m3(mesh: TriangleMesh) -> float:
    """Volume inside the surface with every open rim capped; negative when it is wound inwards."""
    corners = mesh.vertices_m[mesh.triangles]
    volume = np.linalg.det(corners).sum() / 6.0
    for rim in open_rims(mesh):
        points = mesh.vertices_m[rim]
        cap = np.stack([np.broadcast_to(points.mean(axis=0), points.shape), np.roll(points, -1, axis=0), points], 1)
        volume += np.linalg.det(cap).sum() / 6.0
    return float(volume)


def lumen_diameter_m(mesh: TriangleMesh) -> float:
    """Diameter of the circle with the area of the cross-section one width inside the widest open end.

    Raises MeshError if the surface has no open end, or the plane misses it.
    """
    import pyvista

    openings = find_openings(mesh)
    if not openings:
        raise MeshError("surface has no open end to measure its lumen at")
    widest = openings[0]
    surface = pyvista.PolyData.from_regular_faces(mesh.vertices_m, mesh.triangles)
    inside = widest.centre_m - widest.diameter_m * widest.direction
    cut = surface.slice(normal=widest.direction, origin=inside)
    if cut.n_points < 3:
        raise MeshError("surface ends within one width of its widest open end, its lumen cannot be measured there")
    loop = cut.connectivity("closest", closest_point=inside).strip(join=True)
    section = np.asarray(loop.points)[loop.lines[1:]]
    return _measure(section)[2]


def named_openings(mesh: TriangleMesh, names: Sequence[str] = ()) -> list[SurfaceOpening]:
    """Return the open rims, widest first, with these names instead of ``end_0``, ``end_1`` and so on, if there are any.

    Raises MeshError if there is not a name for each, or rims touch.
    """
    found = find_openings(mesh)
    if not names:
        return found
    if len(names) != len(found) or len(set(names)) != len(names):
        raise MeshError(f"{len(found)} open ends need as many different names, got: {', '.join(names)}")
    return [replace(opening, name=name) for opening, name in zip(found, names, strict=True)]


def name_ends(mesh: TriangleMesh, clamped: Sequence[str], mouth: str, names: Sequence[str] = ()) -> TriangleMesh:
    """Add vertex sets ``clamped`` and ``mouth``, and one per open end, to an outward-wound surface.

    Raises MeshError if an end does not exist or is both clamped and the mouth; the message lists the ends with their
    places.
    """
    openings = {opening.name: opening for opening in named_openings(mesh, names)}
    for name in (*clamped, mouth):
        if name not in openings:
            known = "; ".join(
                f"{o.name} at {np.round(1e3 * o.centre_m, 1).tolist()} mm, {1e3 * o.diameter_m:.1f} mm wide"
                for o in openings.values()
            )
            raise MeshError(f"surface has no open end '{name}'; it has: {known or 'none, it is closed'}")
    if mouth in clamped or not clamped:
        raise MeshError(f"open end '{mouth}' cannot be the mouth and clamped, and one end must be clamped")
    sets = {name: opening.rim for name, opening in openings.items()}
    sets["clamped"] = np.concatenate([openings[name].rim for name in clamped])
    sets["mouth"] = openings[mouth].rim
    return TriangleMesh(mesh.vertices_m, mesh.triangles, sets)


def placement(mesh: TriangleMesh, up: Sequence[float] | None = None) -> tuple[FloatArray, FloatArray]:
    """Return where a duct is placed: the clamped end's centre (3,), and as rows the axes x, y, z (3, 3).

    The mouth lies along x; z is as near as can be to ``up``, or else across x in no direction that means anything.
    """
    origin = mesh.vertices_m[mesh.vertex_sets["clamped"]].mean(axis=0)
    towards = mesh.vertices_m[mesh.vertex_sets["mouth"]].mean(axis=0) - origin
    x = towards / np.linalg.norm(towards)
    across = np.zeros(3) if up is None else np.cross(np.cross(x, np.asarray(up, dtype=np.float64)), x)
    if np.linalg.norm(across) < 1e-3:
        across = np.cross(x, np.eye(3)[np.argmin(np.abs(x))])
    z = across / np.linalg.norm(across)
    return origin, np.stack([x, np.cross(z, x), z])


def place_by_ends(mesh: TriangleMesh, up: Sequence[float] | None = None) -> TriangleMesh:
    """Move a duct rigidly so that the clamped end's centre is the origin and the mouth lies along +x."""
    origin, axes = placement(mesh, up)
    return TriangleMesh((mesh.vertices_m - origin) @ axes.T, mesh.triangles, mesh.vertex_sets)
