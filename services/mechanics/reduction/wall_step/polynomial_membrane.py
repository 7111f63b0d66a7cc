"""A membrane as a polynomial of the lowest modes, which are what it reads: a term of the wall; see `cubic_force`."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.reduction.nonlinear.cubic_force import CubicForce


class PolynomialMembrane(Struct):
    """s coordinates, which are modes."""

    coordinates: Annotated[IntArray, "s"]
    quadratic: Annotated[FloatArray, "a", "s"]
    cubic: Annotated[FloatArray, "b", "s"]
    tangent: Annotated[FloatArray, "s", "s"]  # second derivatives, summed over a way

    @classmethod
    def of(cls, force: CubicForce | None) -> PolynomialMembrane:
        """Take a polynomial on, none for a wall without the term."""
        if force is None:
            return cls.zeros(s=0, a=0, b=0)
        plain = {name: np.ascontiguousarray(getattr(force, name)) for name in ("coordinates", "quadratic", "cubic")}
        return cls.zeros(s=len(force.coordinates), **plain)


@kernel
def polynomial_energy(polynomial: PolynomialMembrane, x: FloatArray) -> float:
    """Return the energy at coordinates (s,), in J: by Euler's theorem a third and a quarter of either part's work."""
    energy, pair, triple = 0.0, 0, 0
    for j in range(x.shape[0]):
        for k in range(j, x.shape[0]):
            product = x[j] * x[k]
            for i in range(x.shape[0]):
                energy += product * polynomial.quadratic[pair, i] * x[i] / 3.0
            pair += 1
            for other in range(k, x.shape[0]):
                for i in range(x.shape[0]):
                    energy += 0.25 * product * x[other] * polynomial.cubic[triple, i] * x[i]
                triple += 1
    return energy


@kernel
def add_polynomial_slope(
    polynomial: PolynomialMembrane, x: FloatArray, weights: tuple[float, float], out: FloatArray
) -> None:
    """Add the slope at coordinates (s,) to ``out`` (s,), and the second derivatives to the tangent, by ``weights``."""
    tangent, pair, triple = polynomial.tangent, 0, 0
    for j in range(x.shape[0]):
        for k in range(j, x.shape[0]):
            row = polynomial.quadratic[pair]
            _add(out, row, weights[0] * x[j] * x[k])
            _add(tangent[j], row, weights[1] * x[k])
            _add(tangent[k], row, weights[1] * x[j])
            pair += 1
            for other in range(k, x.shape[0]):
                row = polynomial.cubic[triple]
                _add(out, row, weights[0] * x[j] * x[k] * x[other])
                _add(tangent[j], row, weights[1] * x[k] * x[other])
                _add(tangent[k], row, weights[1] * x[j] * x[other])
                _add(tangent[other], row, weights[1] * x[j] * x[k])
                triple += 1


@kernel
def _add(out: FloatArray, row: FloatArray, factor: float) -> None:
    for i in range(out.shape[0]):
        out[i] += factor * row[i]


@kernel
def add_polynomial_tangent(polynomial: PolynomialMembrane, v: FloatArray, out: FloatArray) -> None:
    """Add the tangent times ``v`` (s,) to ``out`` (s,)."""
    for i in range(v.shape[0]):
        for j in range(v.shape[0]):
            out[i] += polynomial.tangent[i, j] * v[j]
