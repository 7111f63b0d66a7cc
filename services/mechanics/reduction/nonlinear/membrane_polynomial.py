"""The nonlinear membrane's energy in a few modes: an exact polynomial of third and fourth degree.

Restricted to u = Phi q, the cubic and quartic energies of `membrane` are polynomials whose coefficients are summed
over the mesh once; the cost of the force is then O(s^4) in the coordinates s and blind to the mesh (Barbic and
James 2005, "Real-time subspace integration for St. Venant-Kirchhoff deformable models").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane

PairIndices = npt.NDArray[np.intp]
CHUNK = 512
"""Triangles whose strain products exist at the same time: 11 MB with 30 coordinates."""


@dataclass(frozen=True, slots=True)
class MembranePolynomial:
    """Energy C x x x + F x x x x of the membrane beyond the linear one; both tensors are symmetric.

    Attributes:
        coordinates: (s,) int32. The modal coordinates x.
        third: (p, s) float64. C_ijk over pairs i <= j, in the order of `numpy.triu_indices`, and k.
        fourth: (p, p) float64. F_ijkl over pairs i <= j and k <= l.
    """

    coordinates: IntArray
    third: FloatArray
    fourth: FloatArray

    @classmethod
    def from_energies(cls, coordinates: IntArray, third: FloatArray, fourth: FloatArray) -> MembranePolynomial:
        """Make the energies of `energy_tensors` symmetric."""
        s = len(coordinates)
        first, second = np.triu_indices(s)
        pair = np.zeros((s, s), np.intp)
        pair[first, second] = pair[second, first] = np.arange(first.size)
        once = np.where(first == second, 1.0, 0.5)  # a pair of unequal coordinates stands for two products
        C = (third * once)[:, pair]
        C = (C + C.transpose(1, 0, 2) + C.transpose(2, 1, 0)) / 3.0
        F = (once[:, None] * fourth * once)[pair][:, :, pair]
        F = (F + F.transpose(0, 2, 1, 3) + F.transpose(0, 3, 2, 1)) / 3.0
        plain = C[first, second], F[first, second][:, first, second]
        return cls(coordinates, *map(np.ascontiguousarray, plain))


def energy_tensors(membrane: Membrane, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the cubic energy (s, p) and the quartic one (p, p) over pairs p = (j, k), j <= k, unsymmetrised.

    W3 = sum_i sum_p third[i, p] q_i q_j q_k and W4 = sum_p sum_p' fourth[p, p'] q_j q_k q_j' q_k'.
    """
    s = shapes.shape[2]
    first, second = np.triu_indices(s)
    twice = np.where(first == second, 1.0, 2.0)
    third, fourth = np.zeros((s, first.size)), np.zeros((first.size, first.size))
    for start in range(0, len(membrane.triangles), CHUNK):
        part = slice(start, start + CHUNK)
        G = np.einsum("man,mnis->mais", membrane.gradients[part], shapes[membrane.triangles[part]])
        t = np.einsum("mai,mbis->mabs", membrane.tangents[part], G)
        e = np.stack([t[:, 0, 0], t[:, 1, 1], t[:, 0, 1] + t[:, 1, 0]], axis=1)
        eta = twice * _product_strain(G, first, second)
        stress = membrane.rigidity_n_m[part] @ eta
        third += 0.5 * e.reshape(-1, s).T @ stress.reshape(-1, first.size)
        fourth += 0.125 * eta.reshape(-1, first.size).T @ stress.reshape(-1, first.size)
    return third, fourth


def _product_strain(G: FloatArray, first: PairIndices, second: PairIndices) -> FloatArray:
    """Return the symmetric products (G1_j . G1_k, G2_j . G2_k, 2 G1_(j . G2_k)) over pairs, (m, 3, p)."""
    mixed = np.einsum("mais,mbit->mabst", G, G)
    one, other = mixed[..., first, second], mixed[..., second, first]
    shear: FloatArray = one[:, 0, 1] + other[:, 0, 1]
    return np.stack([one[:, 0, 0], one[:, 1, 1], shear], axis=1)
