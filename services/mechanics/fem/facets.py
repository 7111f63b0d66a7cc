"""What it costs that a curved wall is made of flat triangles with stiff drilling freedoms."""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.fem.section import ShellSection
from services.mechanics.surface.mesh import TriangleMesh, half_edges, paired_half_edges, triangle_area_vectors

CREASE_RAD = np.radians(60.0)
"""Triangles that meet at more than this make a crease, not a curved wall."""
FLAT_RAD = 1e-3
EXCESS_PER_SQUARE = 0.1
"""Measured on tubes: `benchmarks/verification_limits.py`."""


def drilling_excess(mesh: TriangleMesh, section: ShellSection) -> float:
    """Return the part by which stiff drilling freedoms make torsion of a curved wall too stiff, about.

    It is 0.1 (h phi / l)², the median over edges, as measured with `andes`: h is the thickness, phi the angle between
    the triangles at an edge and l the edge's length; zero on flat walls. The cause: membrane shear gamma turns a line
    along the wall by gamma / 2 more than it turns the wall itself. A true drilling freedom is the turn of the wall;
    seen from a facet that is tilted by phi / 2 it bends the edge, which the translations of the edge's ends do not.
    Both angles shrink with the facets, and so does the edge over which the mismatch is bent: what remains depends on
    the cells' shape alone, and fades with h² / R². The drilling freedom of `cst` is held so weakly that it follows.
    """
    angle, length, thickness = _inner_edges(mesh, section)
    is_curved = (angle > FLAT_RAD) & (angle < CREASE_RAD)
    if not is_curved.any():
        return 0.0
    return EXCESS_PER_SQUARE * float(np.median((thickness * angle / length)[is_curved] ** 2))


def _inner_edges(mesh: TriangleMesh, section: ShellSection) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(e,) angle between the two triangles of each inner edge, its length, and the wall's thickness there."""
    directed = half_edges(mesh)
    pairs = paired_half_edges(mesh)
    one, other = pairs.T // 3
    area_vectors = triangle_area_vectors(mesh)
    sine = np.linalg.norm(np.cross(area_vectors[one], area_vectors[other]), axis=1)
    is_flipped = directed[pairs[:, 0], 0] == directed[pairs[:, 1], 0]
    cosine = np.where(is_flipped, -1.0, 1.0) * np.sum(area_vectors[one] * area_vectors[other], axis=1)
    ends = mesh.vertices_m[directed[pairs[:, 0]]]
    thickness = section.per_triangle("thickness_m", mesh.n_triangles)
    length: FloatArray = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return np.arctan2(sine, cosine), length, 0.5 * (thickness[one] + thickness[other])
