"""Remainder of the cubic energy: the sharp fields near each node that the sites do not resolve.

A force on a node and the same force spread over the nearest sites have the same field but for what is near the node.
Let x_s be the fields of unit forces on the sites, a the forces there, f those on the nodes, and d_n what the field of a
unit force on node n is beside that of its spread. With D the third derivatives of the shell's energy

    6 E = D a a a + sum_n f_n (3 D d_n a a + 3 D d_n d a + D d_n d d),  a = sum_s a_s x_s,  d = sum_m f_m d_m,

and as d_n is there on a few triangles only, so is what it multiplies: forces on sites and nodes nearby. Sites three
edges apart gave pinches 0.6 to 1.6 times their cubic energy, depending on how they lie.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.fem.nonlinear import CorotationalShell
from trocar.services.mechanics.fem.nonlinear.cubic_energy import third_derivatives_and_fields
from trocar.services.mechanics.reduction.softening.load_sites import LoadSites, Lumen, local_compliance_m_n
from trocar.services.mechanics.reduction.softening.node_energy import fields_of

SITES, NODES = 40, 16
"""Neighbours of a node that are kept: the nearest sites and nodes."""
REMAINDER_WIDTHS = 0.9
"""Of the lumen: triangles within it of a node are where its field is sharp."""


@dataclass(frozen=True, slots=True)
class Remainder:
    """Cubic energy beside that of the sites, of forces along ``inward`` on n nodes; n is zero where it is not known.

    Attributes:
        inward: (n, 3) float64
        sites: (n, p) int32, nodes: (n, q) int32. Nearby each node, itself among them.
        third: (n, p + q, p + q) float32. With z the forces on those, 6 E is larger than that of the sites by the sum of
            f_n z third z.
        local_m_n: (n, n) float32. Inward displacement of nodes under unit forces on them, less rigid motion as in
            `LoadSites`.
    """

    inward: FloatArray
    sites: IntArray
    nodes: IntArray
    third: Float32Array
    local_m_n: Float32Array

    def energies_j(self, at_sites: FloatArray, nodes: IntArray, force_n: FloatArray) -> tuple[float, float]:
        """V, and what E is larger by, of forces (k, 3) on nodes that are spread to (m,) on the sites."""
        at_nodes = np.zeros(len(self.inward))
        np.add.at(at_nodes, nodes, np.sum(self.inward[nodes] * force_n, axis=1))
        pressed = np.flatnonzero(at_nodes)
        z = np.concatenate([at_sites[self.sites[pressed]], at_nodes[self.nodes[pressed]]], axis=1)
        V = 0.5 * float(at_nodes @ self.local_m_n @ at_nodes)
        return V, float(at_nodes[pressed] @ np.einsum("ni,nij,nj->n", z, self.third[pressed], z)) / 6.0


def remainder_of(shell: CorotationalShell, lumen: Lumen, sites: LoadSites, fields: FloatArray) -> Remainder:
    """Differentiate the energy; ``fields`` (6 n, m) are those of unit forces on the sites, whose scale is one."""
    mesh, inward, width_m = shell.model.mesh, lumen.inward, float(np.median(lumen.width_m))
    every = np.arange(mesh.n_vertices, dtype=np.int32)
    alone = fields_of(shell.model, every, inward)
    spread = np.zeros((mesh.n_vertices, len(sites.nodes)))
    np.put_along_axis(spread, sites.near.astype(np.intp), np.einsum("nka,na->nk", sites.weights, inward), axis=1)
    near_sites = _nearest(mesh.vertices_m[sites.nodes], mesh.vertices_m, SITES)
    near_nodes = _nearest(mesh.vertices_m, mesh.vertices_m, NODES)
    third = _third(shell, (fields, alone - fields @ spread.T), (near_sites, near_nodes), REMAINDER_WIDTHS * width_m)
    local = local_compliance_m_n(mesh, lumen, every, alone).astype(np.float32)
    return Remainder(inward, near_sites, near_nodes, third, local)


def no_remainder() -> Remainder:
    """Of a wall of which it is not known."""
    near, none = np.zeros((0, 0), np.int32), np.zeros((0, 0), np.float32)
    return Remainder(np.zeros((0, 3)), near, near, none[None][:0], none)


def _third(
    shell: CorotationalShell, fields: tuple[FloatArray, FloatArray], near: tuple[IntArray, IntArray], reach_m: float
) -> Float32Array:
    """(n, p + q, p + q) sums over the triangles within reach of each node."""
    mesh, (p, q), m = shell.model.mesh, (each.shape[1] for each in near), fields[0].shape[1]
    middles = mesh.vertices_m[mesh.triangles].mean(axis=1)
    within = scipy.spatial.cKDTree(mesh.vertices_m).query_ball_point(middles, reach_m)
    third = np.zeros((mesh.n_vertices, p + q, p + q), np.float32)
    for part, derivatives, local in third_derivatives_and_fields(shell, np.concatenate(fields, axis=1)):
        for D, x, nodes in zip(derivatives, local, within[part], strict=True):
            sharp = x[:, m:]
            A = (sharp[:, nodes].T @ D).reshape(len(nodes), len(x), len(x))
            z = np.concatenate([x[:, near[0][nodes]], sharp[:, near[1][nodes]]], axis=2).transpose(1, 0, 2)
            third[nodes] += z.transpose(0, 2, 1) @ (A @ z)
    third[:, :p, :p] *= 3.0
    third[:, :p, p:] *= 1.5
    third[:, p:, :p] *= 1.5
    return third


def _nearest(among: FloatArray, to: FloatArray, n: int) -> IntArray:
    near = np.asarray(scipy.spatial.cKDTree(among).query(to, min(n, len(among)))[1], np.int32)
    return np.ascontiguousarray(near)
