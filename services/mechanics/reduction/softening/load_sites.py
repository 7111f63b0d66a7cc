"""Sites of a wall: any force on it is spread over the few nearest, so that forces have few coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction.free_dofs import free_load
from trocar.services.mechanics.surface.mesh import TriangleMesh, vertex_areas_m2, vertex_normals

AREA_A_SITE = 0.094
"""Of the square of the lumen's width: a site every 0.3 widths."""
FEWEST, MOST = 40, 180
NEAREST = 6
"""Sites that a force on a node is spread over."""
SCALES = (0.5, 2.0)
"""Within which weights are scaled to a node's own cubic energy."""


@dataclass(frozen=True, slots=True)
class LoadSites:
    """Unit forces on some nodes, inward, and how other forces on the wall are made of them.

    Attributes:
        nodes: (m,) int32
        local_m_n: (m, m) float64. Inward displacement of the sites under unit forces on them, less the rigid motion of
            the piece of wall round each, so that a duct that is bent as a beam counts for nothing; symmetric, not
            negative.
        near: (n, K) int32, weights: (n, K, 3) float64. Force f on a node is ``weights @ f`` on its nearest sites: that
            which comes nearest in energy, times ``scale``.
        scale: (n,) float64. With it a force on the node has the cubic energy of its own (`scaled_to_cubic`).
    """

    nodes: IntArray
    local_m_n: FloatArray
    near: IntArray
    weights: FloatArray
    scale: FloatArray

    def spread(self, nodes: IntArray, force_n: FloatArray) -> FloatArray:
        """(m,) forces on the sites for forces (k, 3) on nodes."""
        at_sites = np.zeros(len(self.nodes))
        np.add.at(at_sites, self.near[nodes], np.einsum("nka,na->nk", self.weights[nodes], force_n))
        return at_sites


@dataclass(frozen=True, slots=True)
class Lumen:
    """The wall as seen from within.

    Attributes:
        inward: (n, 3) float64. Normals of the nodes.
        width_m: (n,) float64. From each node through the lumen to the wall; where there is none, as at an open rim, the
            median of the others.
    """

    inward: FloatArray
    width_m: FloatArray

    @classmethod
    def of(cls, mesh: TriangleMesh) -> Lumen:
        """Look from every node inward.

        Raises ValueError if no node sees the wall opposite: the surface is not wound round a lumen.
        """
        inward = -vertex_normals(mesh)
        width = np.array([_width_m(mesh, node, inward[node]) for node in range(mesh.n_vertices)])
        return cls(inward, np.where(np.isfinite(width), width, _median_m(width)))


def lumen_width_m(mesh: TriangleMesh, nodes: IntArray, inward: FloatArray) -> float:
    """Return the median width of the lumen as some nodes see it along ``inward`` (n, 3).

    Raises ValueError if none of them sees the wall opposite.
    """
    return _median_m(np.array([_width_m(mesh, int(node), inward[node]) for node in nodes]))


def _median_m(width_m: FloatArray) -> float:
    seen = np.isfinite(width_m)
    if not seen.any():
        raise ValueError("the wall encloses no lumen: no node has wall opposite")
    return float(np.median(width_m[seen]))


def _width_m(mesh: TriangleMesh, node: int, direction: FloatArray) -> float:
    """How far the wall opposite is (Moeller and Trumbore's intersection of ray and triangles), infinite if none is."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, k]] for k in range(3))
    across = np.cross(direction, c - a)
    det = np.sum((b - a) * across, axis=1)
    safe = np.where(det == 0.0, 1.0, det)
    start = mesh.vertices_m[node] - a
    u = np.sum(start * across, axis=1) / safe
    turned = np.cross(start, b - a)
    v, distance = turned @ direction / safe, np.sum((c - a) * turned, axis=1) / safe
    near_edge = 1e-9
    hit = (det != 0.0) & (u >= -near_edge) & (v >= -near_edge) & (u + v <= 1.0 + near_edge)
    hit &= (distance > 0.0) & ~(mesh.triangles == node).any(axis=1)
    return float(distance[hit].min()) if hit.any() else np.inf


def place_sites(model: ShellModel, lumen: Lumen, own_m_n: FloatArray) -> tuple[LoadSites, FloatArray]:
    """Spread sites evenly over the free wall; also the fields (6 n, m) of displacement and rotation of unit forces.

    ``own_m_n`` (n,) is the inward displacement of each node under a unit inward force on it.
    """
    mesh = model.mesh
    nodes = evenly_spread(mesh, np.flatnonzero(own_m_n > 1e-3 * own_m_n.max()).astype(np.int32), _how_many(mesh, lumen))
    fields = np.zeros((model.n_dofs, len(nodes)))
    loads = [free_load(model, _unit_force(mesh, node, lumen.inward[node])) for node in nodes]
    fields[model.free_dofs] = model.factor.solve(np.stack(loads, axis=1))
    moved = fields.reshape(-1, 6, len(nodes))[:, :3]
    W = np.einsum("sa,sat->st", lumen.inward[nodes], moved[nodes])
    local = local_compliance_m_n(mesh, lumen, nodes, fields)
    near = np.asarray(scipy.spatial.cKDTree(mesh.vertices_m[nodes]).query(mesh.vertices_m, NEAREST)[1], np.int32)
    weights = np.stack([np.linalg.solve(W[np.ix_(n, n)], u[:, n].T) for n, u in zip(near, moved, strict=True)])
    return LoadSites(nodes, local, near, weights, np.ones(mesh.n_vertices)), fields


def local_compliance_m_n(mesh: TriangleMesh, lumen: Lumen, nodes: IntArray, fields: FloatArray) -> FloatArray:
    """(m, m) inward displacement of nodes, less rigid motion; ``fields`` (6 n, m) are of unit forces on them."""
    moved = fields.reshape(-1, 6, len(nodes))[:, :3]
    whole = np.einsum("sa,sat->st", lumen.inward[nodes], moved[nodes])
    return _not_negative(whole - np.stack([_rigid_part(mesh, lumen, node, moved) for node in nodes]))


def scaled_to_cubic(sites: LoadSites, third: Float32Array, inward: FloatArray, own_j: FloatArray) -> LoadSites:
    """Scale the weights of every node such that a unit inward force on it has its own cubic energy.

    Spread over sites that lie apart, a force is blunter than it was, and its cubic energy (``third``) wrong by a
    factor between 0.3 and 2, from one node to the next; it is the first term of the law. ``own_j`` (n,) is what it
    should be, for unit forces along ``inward`` (n, 3).
    """
    weights = np.einsum("nka,na->nk", sites.weights, inward)
    spread_j = np.array([_cubic_j(third[np.ix_(n, n, n)], w) for n, w in zip(sites.near, weights, strict=True)])
    ratio = np.divide(own_j, spread_j, out=np.ones_like(own_j), where=spread_j != 0.0)
    scale = np.clip(np.cbrt(ratio), *SCALES)
    return replace(sites, weights=sites.weights * scale[:, None, None], scale=sites.scale * scale)


def _cubic_j(third: Float32Array, forces: FloatArray) -> float:
    return float(np.einsum("abc,a,b,c->", third, forces, forces, forces)) / 6.0


def _how_many(mesh: TriangleMesh, lumen: Lumen) -> int:
    area = float(vertex_areas_m2(mesh).sum())
    return int(np.clip(area / (AREA_A_SITE * np.median(lumen.width_m) ** 2), FEWEST, min(MOST, mesh.n_vertices // 2)))


def evenly_spread(mesh: TriangleMesh, candidates: IntArray, n: int) -> IntArray:
    """Up to n of the candidates, each the one that is furthest from those before it."""
    x = mesh.vertices_m[candidates]
    chosen = [int(np.argmax(x @ (x.mean(axis=0) - mesh.vertices_m[mesh.vertex_sets["clamped"]].mean(axis=0))))]
    distance = np.linalg.norm(x - x[chosen[0]], axis=1)
    while len(chosen) < min(n, len(candidates)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(x - x[chosen[-1]], axis=1))
    return np.asarray(candidates[chosen], np.int32)


def _unit_force(mesh: TriangleMesh, node: int, direction: FloatArray) -> FloatArray:
    force = np.zeros((mesh.n_vertices, 3))
    force[node] = direction
    return force


def _rigid_part(mesh: TriangleMesh, lumen: Lumen, node: int, moved: FloatArray) -> FloatArray:
    """(m,) inward displacement of a node by the rigid motion that fits the wall round its stretch of lumen best."""
    inward, width = lumen.inward[node], lumen.width_m[node]
    middle = mesh.vertices_m[node] + 0.5 * width * inward
    round_it = np.flatnonzero(np.linalg.norm(mesh.vertices_m - middle, axis=1) < 0.75 * width)
    motions = _rigid_motions(mesh.vertices_m[round_it] - middle)
    fitted = np.linalg.lstsq(motions.reshape(-1, 6), moved[round_it].reshape(-1, moved.shape[2]), rcond=None)[0]
    own: FloatArray = inward @ _rigid_motions(-0.5 * width * inward[None])[0] @ fitted
    return own


def _rigid_motions(x: FloatArray) -> FloatArray:
    """(k, 3, 6) displacements of points by the six rigid motions."""
    motions = np.zeros((len(x), 3, 6))
    motions[:, :, :3] = np.eye(3)
    for axis in range(3):
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], x)
    return motions


def _not_negative(matrix: FloatArray) -> FloatArray:
    """The symmetric part without its negative eigenvalues."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    part: FloatArray = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return part
