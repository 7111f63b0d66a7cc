"""The modal basis of a duct, and evaluation of the few rows that a contact or a viewer needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import summing_kernel
from trocar.services.mechanics.reduction.content_hash import hash_content


@dataclass(frozen=True, slots=True)
class ModalBasis:
    """The lowest r modes of a supported duct, mass normalised: Phi^T M Phi = 1, Phi^T K Phi = omega^2.

    Attributes:
        omega_rad_s: (r,) float64. Circular frequencies in ascending order.
        Phi: (n, 3, r) float64. Translations of every node, zero rows where a node is fixed. A node's three rows lie
            together, so that a contact touches 24 r bytes of memory whatever the size of the mesh.
        content_hash: str. Hash of the two arrays' bytes. Two bases agree bit by bit if their hashes do; the same duct
            solved on another machine may return double modes turned against each other, and then has another hash.
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
        field: FloatArray = (self.Phi.reshape(-1, self.n_modes) @ q).reshape(-1, 3)
        return field


@summing_kernel
def gather_modes(
    points: tuple[IntArray, FloatArray],
    Phi: FloatArray,
    motion: tuple[FloatArray, FloatArray],
    out: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Write the modes' rows at points of triangles, and what two states of the modes displace the points by.

    Args:
        points: (nodes (k, 3), weights (k, 3)). Corners and barycentric coordinates; the weights are zero where a point
            is not on the duct.
        Phi: (n, 3, r) float64
        motion: (q (r,), dq (r,))
        out: (rows (3 k, r), (k, 3), (k, 3)). ``rows @ q`` and ``rows @ dq`` are the displacements; ``rows.T @ f`` is
            the modal force of forces f.
    """
    (nodes, weights), (q, dq), (rows, at_q, at_dq) = points, motion, out
    for point in range(nodes.shape[0]):
        u, v, w = weights[point, 0], weights[point, 1], weights[point, 2]
        first, second, third = nodes[point, 0], nodes[point, 1], nodes[point, 2]
        for axis in range(3):
            row, total, change = 3 * point + axis, 0.0, 0.0
            for mode in range(q.shape[0]):
                shape = u * Phi[first, axis, mode] + v * Phi[second, axis, mode] + w * Phi[third, axis, mode]
                rows[row, mode] = shape
                total += shape * q[mode]
                change += shape * dq[mode]
            at_q[point, axis], at_dq[point, axis] = total, change
