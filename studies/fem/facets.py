"""What it costs that a curved wall is made of flat triangles with stiff drilling freedoms."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem.elements.andes import ALPHA_B
from trocar.services.mechanics.fem.section import ShellSection
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    edge_of_half_edges,
    half_edges,
    paired_half_edges,
    triangle_area_vectors,
)

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


def rim_eccentricity(mesh: TriangleMesh, section: ShellSection, vertices: IntArray) -> float:
    """Return by how much of the wall's thickness forces on rim vertices act beside a wall with stiff drilling freedoms.

    A force per length N across an edge of length l turns the drilling freedoms of its ends by moments alpha_b N l² / 12
    against each other (`elements.andes`). On a flat rim those of two neighbours cancel; where these are tilted by an
    angle phi, what is left bends the wall like a moment N e per length with e = alpha_b l phi / 12. Forces on vertices
    bring no such moments, nor do supports that leave rotations free. A cylinder's rim then moves by
    6 (1 - nu²) / sqrt(3 (1 - nu²)) N e R / (E t²) across its wall. The median over open edges between two of the
    ``vertices``; zero where these are straight.
    """
    directed = half_edges(mesh)
    _, edge, shared = edge_of_half_edges(mesh)
    is_named = np.zeros(mesh.n_vertices, bool)
    is_named[vertices] = True
    open_edges = np.flatnonzero((shared[edge] == 1) & is_named[directed].all(axis=1))
    area_vectors = triangle_area_vectors(mesh)[open_edges // 3]
    normals = area_vectors / np.linalg.norm(area_vectors, axis=1, keepdims=True)
    before = {int(end): k for k, end in enumerate(directed[open_edges, 1])}
    pairs = [(before[start], k) for k, start in enumerate(directed[open_edges, 0].tolist()) if start in before]
    if not pairs:
        return 0.0
    one, other = np.array(pairs).T
    angle = np.arccos(np.clip(np.sum(normals[one] * normals[other], axis=1), -1.0, 1.0))
    angle[(angle < FLAT_RAD) | (angle > CREASE_RAD)] = 0.0
    ends = mesh.vertices_m[directed[open_edges]]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    thickness = section.per_triangle("thickness_m", mesh.n_triangles)[open_edges // 3]
    return float(np.median(ALPHA_B / 12.0 * length[other] * angle / thickness[other]))


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
