"""Whether a wall is thin enough to be a shell at all, and thin enough for one without transverse shear."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.section import ShellSection
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    edge_of_half_edges,
    triangle_area_vectors,
    triangle_areas_m2,
    vertex_components,
)

THIN = 1.0 / 50.0
"""Thickness over radius up to which `dkt` is within 1 % of a solid: shear adds half of that to the deflection of a
pinched tube, see `docs/decisions/thick-walls.md`."""


def bending_of_wall(mesh: TriangleMesh, section: ShellSection) -> str:
    """Return the bending triangle of a wall that is pressed: `dkt` where it is thin, `reissner` elsewhere."""
    thickness = float(section.per_triangle("thickness_m", mesh.n_triangles).max())
    return "dkt" if thickness * mean_curvature_1_m(mesh) <= THIN else "reissner"


def mean_curvature_1_m(mesh: TriangleMesh) -> float:
    """Return the sum of both principal curvatures, its mean over the wall: 1 / R of a tube, straight or bent.

    It is Steiner's formula: each edge turns the normal by its angle over its length. Turns both ways cancel, so
    rough surfaces have that of the smooth ones they follow.
    """
    area = triangle_area_vectors(mesh)
    normals = area / np.linalg.norm(area, axis=1, keepdims=True)
    edges, edge, counts = edge_of_half_edges(mesh)
    order = np.argsort(edge, kind="stable")
    starts = np.searchsorted(edge[order], np.flatnonzero(counts == 2))
    one, other = order[starts] // 3, order[starts + 1] // 3
    ends = mesh.vertices_m[edges[counts == 2]]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    across = mesh.vertices_m[mesh.triangles[other]].mean(axis=1) - mesh.vertices_m[mesh.triangles[one]].mean(axis=1)
    folded = np.linalg.norm(np.cross(normals[one], normals[other]), axis=1)
    angle = np.arctan2(folded, np.einsum("ei,ei->e", normals[one], normals[other]))
    outward = np.sign(np.einsum("ei,ei->e", normals[other] - normals[one], across))
    return abs(float(np.sum(outward * angle * length) / triangle_areas_m2(mesh).sum()))


def thickness_over_width(mesh: TriangleMesh, section: ShellSection) -> tuple[float, FloatArray]:
    """Largest ratio of thickness to width of all connected pieces, and the (3,) centre of that piece in m.

    Width is the middle one of a piece's three principal extents: a plate's shorter side, a tube's diameter.
    """
    thickness = section.per_triangle("thickness_m", mesh.n_triangles)
    pieces = vertex_components(mesh)
    thickest = np.zeros(int(pieces.max()) + 1)
    np.maximum.at(thickest, pieces[mesh.triangles[:, 0]], thickness)
    order = np.argsort(pieces, kind="stable")
    worst = (0.0, mesh.vertices_m[0])
    for piece, vertices in enumerate(np.split(order, np.flatnonzero(np.diff(pieces[order])) + 1)):
        centre = mesh.vertices_m[vertices].mean(axis=0)
        arms = mesh.vertices_m[vertices] - centre
        extents = np.ptp(arms @ np.linalg.eigh(arms.T @ arms)[1], axis=0)
        width = float(np.sort(extents)[1])
        ratio = float(thickest[piece]) / width if width > 0.0 else float("inf")
        worst = max(worst, (ratio, centre), key=lambda found: found[0])
    return worst


def check_thin(mesh: TriangleMesh, section: ShellSection) -> None:
    """Refuse a wall that is thicker than the piece it belongs to is wide.

    Raises ValueError that names the piece by its place, and both lengths.
    """
    ratio, centre = thickness_over_width(mesh, section)
    if ratio > 1.0:
        raise ValueError(
            f"section: thickness_m is {ratio:.3g} times the width of the piece round "
            f"{(np.round(1e3 * centre, 2) + 0.0).tolist()} mm, that is no shell: is one of them in another unit?"
        )
