"""The reduced nonlinear membrane force: an exact cubic polynomial of the modal coordinates.

Restricted to u = Phi q, the cubic and quartic energies of `membrane` are polynomials whose coefficients are summed
over the mesh once; the cost of the force is then O(s^4) in the coordinates s and blind to the mesh (Barbic and
James 2005, "Real-time subspace integration for St. Venant-Kirchhoff deformable models").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane

PairIndices = npt.NDArray[np.intp]
CHUNK = 512
"""Triangles whose strain products exist at the same time: 11 MB with 30 coordinates."""


@dataclass(frozen=True, slots=True)
class CubicForce:
    """Modal force of the membrane beyond the linear one.

    Attributes:
        coordinates: (s,) int32. The modal coordinates it acts in.
        quadratic: (s (s + 1) / 2, s) float64. Force per product q_j q_k, j <= k, in the order of
            `itertools.combinations_with_replacement`.
        cubic: (s (s + 1) (s + 2) / 6, s) float64. Force per product q_j q_k q_l, j <= k <= l.
    """

    coordinates: IntArray
    quadratic: FloatArray
    cubic: FloatArray

    @classmethod
    def from_energies(cls, coordinates: IntArray, third: FloatArray, fourth: FloatArray) -> CubicForce:
        """Differentiate the energies of `energy_tensors`."""
        return cls(coordinates, _quadratic_coefficients(third), _cubic_coefficients(fourth))

    def add_force(self, q: FloatArray, out: FloatArray, scratch: FloatArray) -> None:
        """Add the internal force of the state q (r,) to ``out`` (r,); ``scratch`` is (2, s).

        It is the gradient of the energy: subtract it from what drives the modes.
        """
        add_cubic_force(self.coordinates, self.quadratic, self.cubic, q, out, scratch)

    def energy_j(self, q: FloatArray) -> float:
        """Return the energy in J."""
        work, scratch = np.zeros((2, q.size)), np.zeros((2, self.coordinates.size))
        energy: float = cubic_energy_j(self.coordinates, self.quadratic, self.cubic, q, work, scratch)
        return energy


@kernel
def add_cubic_force(
    coordinates: IntArray, quadratic: FloatArray, cubic: FloatArray, q: FloatArray, out: FloatArray, scratch: FloatArray
) -> None:
    """Evaluate the polynomial: monomials in the outer loops, the force they make in the innermost."""
    s = coordinates.shape[0]
    x, force = scratch[0], scratch[1]
    for i in range(s):
        x[i] = q[coordinates[i]]
        force[i] = 0.0
    pair, triple = 0, 0
    for j in range(s):
        for k in range(j, s):
            product = x[j] * x[k]
            for i in range(s):
                force[i] += product * quadratic[pair, i]
            pair += 1
            if cubic.shape[0] > 0:
                for other in range(k, s):
                    monomial = product * x[other]
                    for i in range(s):
                        force[i] += monomial * cubic[triple, i]
                    triple += 1
    for i in range(s):
        out[coordinates[i]] += force[i]


@kernel
def cubic_energy_j(
    coordinates: IntArray,
    quadratic: FloatArray,
    cubic: FloatArray,
    q: FloatArray,
    work: FloatArray,
    scratch: FloatArray,
) -> float:
    """Return the energy in J, by Euler's theorem a third and a quarter of the parts' work q . f; ``work`` is (2, r)."""
    work[:] = 0.0
    add_cubic_force(coordinates, quadratic, cubic[:0], q, work[0], scratch)
    add_cubic_force(coordinates, quadratic, cubic, q, work[1], scratch)
    energy = 0.0
    for mode in range(q.shape[0]):
        energy += q[mode] * (work[0, mode] / 3.0 + (work[1, mode] - work[0, mode]) / 4.0)
    return energy


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


def _quadratic_coefficients(third: FloatArray) -> FloatArray:
    """Return dW3/dq_i per q_j q_k, from the energy over (i, pair)."""
    s = third.shape[0]
    energy: dict[tuple[int, ...], float] = {}
    pairs = list(combinations_with_replacement(range(s), 2))
    for column, (j, k) in enumerate(pairs):
        for i in range(s):
            monomial = tuple(sorted((i, j, k)))
            energy[monomial] = energy.get(monomial, 0.0) + third[i, column]
    return _differentiate(energy, pairs, s)


def _cubic_coefficients(fourth: FloatArray) -> FloatArray:
    """Return dW4/dq_i per q_j q_k q_l, from the energy over (pair, pair)."""
    s = int((np.sqrt(8.0 * len(fourth) + 1.0) - 1.0) / 2.0)
    energy: dict[tuple[int, ...], float] = {}
    pairs = list(combinations_with_replacement(range(s), 2))
    for row, one in enumerate(pairs):
        for column, other in enumerate(pairs):
            monomial = tuple(sorted(one + other))
            energy[monomial] = energy.get(monomial, 0.0) + fourth[row, column]
    return _differentiate(energy, list(combinations_with_replacement(range(s), 3)), s)


def _differentiate(energy: dict[tuple[int, ...], float], products: Sequence[tuple[int, ...]], s: int) -> FloatArray:
    """Differentiate a homogeneous polynomial given by its monomials: rows are products, columns derivatives."""
    out = np.zeros((len(products), s))
    for row, product in enumerate(products):
        for i in range(s):
            monomial = tuple(sorted((*product, i)))
            out[row, i] = monomial.count(i) * energy[monomial]
    return out
