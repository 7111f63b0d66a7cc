"""A membrane as a polynomial of the lowest modes, which are what it reads: a term of the wall.

With A = C x and B = F x x, the energy is (A + B) x x, its slope (3 A + 4 B) x and its second derivative 6 A + 12 B: all
follow from the same two products of matrices over pairs of coordinates. See `membrane_polynomial`.
"""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel, summing_kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.reduction.nonlinear.membrane_polynomial import MembranePolynomial


class PolynomialMembrane(Struct):
    """s coordinates, which are modes, and p pairs of them."""

    coordinates: Annotated[IntArray, "s"]
    third: Annotated[FloatArray, "p", "s"]
    fourth: Annotated[FloatArray, "p", "p"]
    products: Annotated[FloatArray, "p"]  # scratch: of both coordinates, twice where they are unequal
    forms: Annotated[FloatArray, "p", 2]  # scratch: A and B
    tangent: Annotated[FloatArray, "s", "s"]  # second derivatives, summed over a way

    @classmethod
    def of(cls, polynomial: MembranePolynomial | None) -> PolynomialMembrane:
        """Take a polynomial on, none for a wall without the term."""
        if polynomial is None:
            return cls.zeros(s=0, p=0)
        arrays = {name: getattr(polynomial, name) for name in ("coordinates", "third", "fourth")}
        return cls.zeros(s=len(polynomial.coordinates), p=len(polynomial.third), **arrays)


@kernel
def polynomial_energy(polynomial: PolynomialMembrane, x: FloatArray) -> float:
    """Return the energy at coordinates (s,), in J."""
    _write_forms(polynomial, x)
    energy = 0.0
    for pair in range(polynomial.products.shape[0]):
        energy += polynomial.products[pair] * (polynomial.forms[pair, 0] + polynomial.forms[pair, 1])
    return energy


@kernel
def add_polynomial_slope(
    polynomial: PolynomialMembrane, x: FloatArray, weights: tuple[float, float], out: FloatArray
) -> float:
    """Add the slope at coordinates (s,) to ``out`` (s,), and the second derivatives to the tangent, by ``weights``.

    Return the energy, in J.
    """
    energy, tangent, pair = polynomial_energy(polynomial, x), polynomial.tangent, 0
    for i in range(x.shape[0]):
        for j in range(i, x.shape[0]):
            A, B = polynomial.forms[pair, 0], polynomial.forms[pair, 1]
            slope, stiff = weights[0] * (3.0 * A + 4.0 * B), weights[1] * (6.0 * A + 12.0 * B)
            out[i] += slope * x[j]
            tangent[i, j] += stiff
            if j > i:
                out[j] += slope * x[i]
                tangent[j, i] += stiff
            pair += 1
    return energy


@summing_kernel
def _write_forms(polynomial: PolynomialMembrane, x: FloatArray) -> None:
    """Write the products of coordinates (s,), A and B."""
    products, pair = polynomial.products, 0
    for i in range(x.shape[0]):
        for j in range(i, x.shape[0]):
            products[pair] = x[i] * x[j] * (1.0 if i == j else 2.0)
            pair += 1
    for row in range(products.shape[0]):
        A = B = 0.0
        for k in range(x.shape[0]):
            A += polynomial.third[row, k] * x[k]
        for column in range(products.shape[0]):
            B += polynomial.fourth[row, column] * products[column]
        polynomial.forms[row, 0], polynomial.forms[row, 1] = A, B


@kernel
def add_polynomial_tangent(polynomial: PolynomialMembrane, v: FloatArray, out: FloatArray) -> None:
    """Add the tangent times ``v`` (s,) to ``out`` (s,)."""
    for i in range(v.shape[0]):
        for j in range(v.shape[0]):
            out[i] += polynomial.tangent[i, j] * v[j]
