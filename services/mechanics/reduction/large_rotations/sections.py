"""Cross-sections of a tube: stations along its axis, and how far along it each node lies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    triangle_areas_m2,
    unique_edges,
    vertex_areas_m2,
)


@dataclass(frozen=True, slots=True)
class Sections:
    """Stations along the axis of a tube held at one end.

    Attributes:
        centres_m: (s + 1, 3) float64. Points of the axis, the first amid the held nodes.
        segment: (n,) int32. Between which stations each node lies: ``segment`` and ``segment + 1``.
        fraction: (n,) float64. How far between them, 0 to 1.
    """

    centres_m: FloatArray
    segment: IntArray
    fraction: FloatArray

    @property
    def n_stations(self) -> int:
        """Number of stations, s + 1."""
        return len(self.centres_m)

    def shares(self) -> scipy.sparse.csc_array:
        """Return the weights (n, s + 1) with which stations are interpolated to nodes; rows sum to one."""
        n = self.segment.size
        rows = np.concatenate([np.arange(n), np.arange(n)])
        columns = np.concatenate([self.segment, self.segment + 1])
        values = np.concatenate([1.0 - self.fraction, self.fraction])
        return scipy.sparse.csc_array((values, (rows, columns)), shape=(n, self.n_stations))

    def rings(self, mesh: TriangleMesh) -> Iterator[tuple[IntArray, FloatArray, FloatArray, FloatArray]]:
        """Yield for each station but the first its nodes (k,), their weights (k,) of sum one, arms (k, 3) and inertia.

        The inertia (3, 3), in square metres, is what a turn's moment is divided by.
        """
        shares, areas_m2 = self.shares(), vertex_areas_m2(mesh)
        for station in range(1, self.n_stations):
            own = slice(shares.indptr[station], shares.indptr[station + 1])
            nodes = shares.indices[own]
            weight = shares.data[own] * areas_m2[nodes]
            weight /= weight.sum()
            arm = mesh.vertices_m[nodes] - self.centres_m[station]
            second = np.einsum("k,ki,kj->ij", weight, arm, arm)
            yield nodes, weight, arm, np.trace(second) * np.eye(3) - second


MOST_CONDITION = 1e6
"""Of a section's inertia: that of a ring is 2, of nodes on a line infinite but for rounding."""


def cut_sections(mesh: TriangleMesh, held: IntArray, n_segments: int) -> Sections:
    """Divide a tube into ``n_segments`` from its held nodes to its farthest.

    Raises ValueError if a section would hold no node, or none beside a line: it has no turn then.

    Args:
        mesh: TriangleMesh. Any connected surface that is held at one end.
        held: (k,) int. Nodes of the held end.
        n_segments: int. At least two.
    """
    if n_segments > mesh.n_vertices:
        raise ValueError(f"the mesh is too coarse for {n_segments} cross-sections: it has {mesh.n_vertices} nodes")
    place = np.clip(axial_coordinate(mesh, held) * n_segments, 0.0, n_segments)
    segment = np.minimum(place.astype(np.int32), n_segments - 1)
    fraction = place - segment
    sections = Sections(np.zeros((n_segments + 1, 3)), segment, fraction)
    weights = sections.shares().T * vertex_areas_m2(mesh)
    total = np.asarray(weights.sum(axis=1)).ravel()
    if not (total > 0.0).all():
        raise ValueError(f"the mesh is too coarse for {n_segments} cross-sections: one of them holds no node")
    centres = np.asarray(weights @ mesh.vertices_m) / total[:, None]
    centres[0] = mesh.vertices_m[held].mean(axis=0)
    sections = Sections(centres, segment, fraction)
    if any(np.linalg.cond(inertia_m2) > MOST_CONDITION for *_, inertia_m2 in sections.rings(mesh)):
        raise ValueError(f"the mesh is too coarse for {n_segments} cross-sections: the nodes of one lie on a line")
    return sections


def refuse_unless_tube(mesh: TriangleMesh, held: IntArray) -> None:
    """Check that a mesh is a tube, a cylinder by its topology, and that one whole end of it is held.

    Raises ValueError if it is not; the sentence says why.
    """
    rims = boundary_loops(mesh)
    euler = mesh.n_vertices - len(unique_edges(mesh)[0]) + mesh.n_triangles
    if len(rims) != 2 or euler != 0:
        raise ValueError(f"the duct must be a tube with two open ends, its surface has {len(rims)}")
    if not any(set(rim.tolist()) == set(held.tolist()) for rim in rims):
        raise ValueError("the duct must be held at one whole end and nowhere else")


def axial_coordinate(mesh: TriangleMesh, held: IntArray) -> FloatArray:
    """Return how far along the tube each node lies (n,), 0 at the held nodes and 1 at the farthest.

    From the Poisson problem -div grad p = 1 with p = 0 at the held nodes and natural ends elsewhere: in one
    dimension p = x (2 L - x) / 2, which is solved for x. Smooth on any mesh, unlike a distance along edges, and
    blind to incisions (Spalding and Tucker's wall distance rests on the same problem).
    """
    free = np.setdiff1d(np.arange(mesh.n_vertices), held)
    laplacian = cotangent_laplacian(mesh)[free][:, free]
    p = np.zeros(mesh.n_vertices)
    p[free] = factorise(scipy.sparse.csc_array(laplacian)).solve(vertex_areas_m2(mesh)[free])
    coordinate: FloatArray = 1.0 - np.sqrt(np.maximum(1.0 - p / p.max(), 0.0))
    return coordinate


def cotangent_laplacian(mesh: TriangleMesh) -> scipy.sparse.csc_array:
    """Return the stiffness (n, n) of the scalar Laplace operator with linear triangles."""
    corners = mesh.vertices_m[mesh.triangles]
    opposite = np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)
    element = np.einsum("mik,mjk->mij", opposite, opposite) / (4.0 * triangle_areas_m2(mesh)[:, None, None])
    rows = np.repeat(mesh.triangles, 3, axis=1).ravel()
    columns = np.tile(mesh.triangles, (1, 3)).ravel()
    shape = (mesh.n_vertices, mesh.n_vertices)
    return scipy.sparse.csc_array(scipy.sparse.coo_array((element.ravel(), (rows, columns)), shape=shape))
