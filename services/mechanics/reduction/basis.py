"""The modal basis of a duct, and evaluation of the few rows that a contact or a viewer needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import kernel
from services.mechanics.reduction.content_hash import hash_content


@dataclass(frozen=True, slots=True)
class ModalBasis:
    """The lowest r modes of a supported duct, mass normalised: Phi^T M Phi = 1, Phi^T K Phi = omega^2.

    Attributes
    ----------
    omega_rad_s : (r,) float64
        Circular frequencies in ascending order.
    Phi : (n, 3, r) float64
        Translations of every node, zero rows where a node is fixed. A node's three rows lie together, so
        that a contact touches 24 r bytes of memory whatever the size of the mesh.
    content_hash : str
        Hash of the two arrays' bytes. Two bases agree bit by bit if their hashes do; the same duct solved on
        another machine may return double modes turned against each other, and then has another hash.
    """

    omega_rad_s: FloatArray
    Phi: FloatArray
    content_hash: str

    @classmethod
    def from_modes(cls, omega_rad_s: FloatArray, Phi: FloatArray) -> ModalBasis:
        """Wrap frequencies (r,) and shapes (n, 3, r), hashing them."""
        omega_rad_s = np.ascontiguousarray(omega_rad_s, np.float64)
        Phi = np.ascontiguousarray(Phi, np.float64)
        if Phi.ndim != 3 or Phi.shape[1] != 3 or omega_rad_s.shape != Phi.shape[2:]:
            raise ValueError(f"modes of shape {Phi.shape} do not fit {omega_rad_s.shape} frequencies")
        return cls(omega_rad_s, Phi, hash_content(omega_rad_s, Phi))

    @property
    def n_nodes(self) -> int:
        """Number of nodes of the mesh, fixed ones included."""
        return int(self.Phi.shape[0])

    @property
    def n_modes(self) -> int:
        """Number of modes r."""
        return int(self.Phi.shape[2])

    def displacements(self, q: FloatArray) -> FloatArray:
        """Return the displacement of every node (n, 3) in m: eq. 22."""
        field: FloatArray = self.Phi @ q
        return field


@kernel
def node_displacement(node: int, Phi: FloatArray, q: FloatArray, out: FloatArray) -> None:
    """Write the modal displacement of one node into ``out`` (3,), in m."""
    for axis in range(3):
        total = 0.0
        for mode in range(q.shape[0]):
            total += Phi[node, axis, mode] * q[mode]
        out[axis] = total


@kernel
def node_displacements(nodes: IntArray, Phi: FloatArray, q: FloatArray, out: FloatArray) -> None:
    """Write the modal displacements of ``nodes`` (k,) into ``out`` (k, 3), in m."""
    for k in range(nodes.shape[0]):
        node_displacement(nodes[k], Phi, q, out[k])


@kernel
def gather_modes(nodes: IntArray, weights: FloatArray, Phi: FloatArray, out: FloatArray) -> None:
    """Write the modes' rows at points of triangles into ``out`` (3 k, r).

    ``nodes`` (k, 3) are the corners and ``weights`` (k, 3) the barycentric coordinates of each point, so
    that ``out @ q`` is the points' displacement and ``out.T @ f`` the modal force of forces f on them.
    """
    for point in range(nodes.shape[0]):
        for axis in range(3):
            row = out[3 * point + axis]
            row[:] = 0.0
            for corner in range(3):
                weight = weights[point, corner]
                if weight != 0.0:
                    shapes = Phi[nodes[point, corner], axis]
                    for mode in range(row.shape[0]):
                        row[mode] += weight * shapes[mode]
