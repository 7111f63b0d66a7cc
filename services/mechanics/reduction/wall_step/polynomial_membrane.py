"""A membrane as a polynomial of the lowest modes: a term of the wall's potential, see `nonlinear.cubic_force`.

It relaxes as `sampled_membrane` does, with lagging coordinates.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, Float32Array, FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.reduction.nonlinear.cubic_force import CubicForce
from trocar.services.mechanics.reduction.viscoelastic import PronySeries


class PolynomialMembrane(Struct):
    """s coordinates, which are modes; t terms of a Prony series."""

    coordinates: Annotated[IntArray, "s"]
    quadratic: Annotated[FloatArray, "a", "s"]
    cubic: Annotated[FloatArray, "b", "s"]
    root: Annotated[FloatArray, "s"]
    g: Annotated[FloatArray, "t"]
    behind: Annotated[FloatArray, "t", "s"]  # state: the lagging coordinates
    start: Annotated[FloatArray, "s"]  # state: where the step begins
    at: Annotated[FloatArray, "s"]  # where it ends
    along: Annotated[FloatArray, "s"]
    searched: Annotated[FloatArray, "s"]
    place: Annotated[FloatArray, "s"]
    gap: Annotated[FloatArray, "s"]
    out: Annotated[FloatArray, "s"]

    @classmethod
    def of(cls, force: CubicForce | None, series: PronySeries) -> PolynomialMembrane:
        """Take a polynomial on, none for a wall without the term; ``series`` is how the wall relaxes, if it does."""
        g = np.array(series.g, np.float64)
        if force is None:
            return cls.zeros(s=0, a=0, b=0, t=len(g), g=g)
        plain = {name: np.ascontiguousarray(getattr(force, name)) for name in ("coordinates", "quadratic", "cubic")}
        return cls.zeros(s=len(force.coordinates), t=len(g), g=g, **plain)

    def take_root(self, root: FloatArray) -> None:
        """Prepare for the coordinates of `WallStep`, of which each moves its mode by ``root`` (r,)."""
        self.root[:] = root[self.coordinates]

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        return self.behind, self.start


polynomial_at = reader(PolynomialMembrane)


@kernel
def polynomial_energy(polynomial: PolynomialMembrane, q: FloatArray) -> float:
    """Return the energy at modal coordinates (r,), in J."""
    place = _place_at(polynomial, q)
    total = _lasts(polynomial) * _energy(polynomial, place)
    for term in range(polynomial.g.shape[0]):
        total += polynomial.g[term] * _energy(polynomial, _gap(polynomial, term))
    return total


@kernel
def polynomial_force(address: Address[PolynomialMembrane], q: FloatArray, out: FloatArray) -> None:
    """Subtract the slope of the energy at modal coordinates (r,) from ``out`` (r,)."""
    polynomial = polynomial_at(address)
    _place_at(polynomial, q)
    polynomial.out[:] = 0.0
    _add_slope(polynomial, 1.0)
    for i in range(polynomial.coordinates.shape[0]):
        out[polynomial.coordinates[i]] -= polynomial.out[i]


@kernel
def polynomial_tangent_times(
    address: Address[PolynomialMembrane], q: FloatArray, v: FloatArray, out: FloatArray
) -> None:
    """Add the second derivative of the energy at ``q`` (r,), times ``v`` (r,), to ``out`` (r,)."""
    polynomial = polynomial_at(address)
    for i in range(polynomial.coordinates.shape[0]):
        polynomial.searched[i] = v[polynomial.coordinates[i]]
    _place_at(polynomial, q)
    polynomial.out[:] = 0.0
    _add_tangent(polynomial, 1.0)
    for i in range(polynomial.coordinates.shape[0]):
        out[polynomial.coordinates[i]] += polynomial.out[i]


@kernel
def relax_polynomial(polynomial: PolynomialMembrane, q: FloatArray, decay: FloatArray) -> float:
    """Let the lagging coordinates follow the modal ones (r,) by ``decay`` (t,), and return the energy lost."""
    lost, place = 0.0, _place_at(polynomial, q)
    for term in range(polynomial.g.shape[0]):
        lost += polynomial.g[term] * _energy(polynomial, _gap(polynomial, term))
        for i in range(place.shape[0]):
            polynomial.behind[term, i] = place[i] - decay[term] * (place[i] - polynomial.behind[term, i])
        lost -= polynomial.g[term] * _energy(polynomial, _gap(polynomial, term))
    return lost


@kernel
def begin_polynomial(polynomial: PolynomialMembrane, q: FloatArray) -> None:
    """Note modal coordinates (r,), where a step begins."""
    for i in range(polynomial.coordinates.shape[0]):
        polynomial.start[i] = q[polynomial.coordinates[i]]


@kernel
def stretch_polynomial(polynomial: PolynomialMembrane, end: AnyArray) -> None:
    """Note where a step ends, in the coordinates (r,) of `WallStep`."""
    for i in range(polynomial.coordinates.shape[0]):
        polynomial.at[i] = polynomial.root[i] * end[polynomial.coordinates[i]]


@kernel
def add_polynomial_pull(polynomial: PolynomialMembrane, points: tuple[float, float], out: Float32Array) -> None:
    """Subtract the mean slope over the step from ``out`` (r,); ``points`` are places on the way of equal weight."""
    _mean_slope(polynomial, points, 0.0)
    for i in range(polynomial.coordinates.shape[0]):
        out[polynomial.coordinates[i]] -= polynomial.root[i] * polynomial.out[i]


@kernel
def add_polynomial_tangent(
    polynomial: PolynomialMembrane, points: tuple[float, float], search: Float32Array, out: Float32Array
) -> None:
    """Add the derivative of the mean slope by the end, times ``search`` (r,), to ``out`` (r,)."""
    for i in range(polynomial.coordinates.shape[0]):
        polynomial.searched[i] = polynomial.root[i] * search[polynomial.coordinates[i]]
    _mean_tangent(polynomial, points, 0.0)
    for i in range(polynomial.coordinates.shape[0]):
        out[polynomial.coordinates[i]] += polynomial.root[i] * polynomial.out[i]


@kernel
def polynomial_slope_along(
    polynomial: PolynomialMembrane, points: tuple[float, float], length: float
) -> tuple[float, float]:
    """Return the mean slope along the search's step at a part of it, and the derivative of that by the part."""
    slope = curvature = 0.0
    _mean_slope(polynomial, points, length)
    for i in range(polynomial.coordinates.shape[0]):
        slope += polynomial.out[i] * polynomial.along[i]
        polynomial.searched[i] = polynomial.along[i]
    _mean_tangent(polynomial, points, length)
    for i in range(polynomial.coordinates.shape[0]):
        curvature += polynomial.out[i] * polynomial.along[i]
    return slope, curvature


@kernel
def _mean_slope(polynomial: PolynomialMembrane, points: tuple[float, float], length: float) -> None:
    """Write the mean slope on the way to ``at`` and a part of ``along`` more."""
    polynomial.out[:] = 0.0
    for point in points:
        _place_on_way(polynomial, point, length)
        _add_slope(polynomial, 0.5)


@kernel
def _mean_tangent(polynomial: PolynomialMembrane, points: tuple[float, float], length: float) -> None:
    """Write the derivative of that mean by the end, times ``searched``."""
    polynomial.out[:] = 0.0
    for point in points:
        _place_on_way(polynomial, point, length)
        _add_tangent(polynomial, 0.5 * point)


@kernel
def _place_on_way(polynomial: PolynomialMembrane, point: float, length: float) -> None:
    for i in range(polynomial.place.shape[0]):
        start = polynomial.start[i]
        polynomial.place[i] = start + point * (polynomial.at[i] + length * polynomial.along[i] - start)


@kernel
def _place_at(polynomial: PolynomialMembrane, q: FloatArray) -> FloatArray:
    for i in range(polynomial.place.shape[0]):
        polynomial.place[i] = q[polynomial.coordinates[i]]
    return polynomial.place


@kernel
def _gap(polynomial: PolynomialMembrane, term: int) -> FloatArray:
    """Return what the place is ahead of a term."""
    for i in range(polynomial.gap.shape[0]):
        polynomial.gap[i] = polynomial.place[i] - polynomial.behind[term, i]
    return polynomial.gap


@kernel
def _lasts(polynomial: PolynomialMembrane) -> float:
    share = 1.0
    for term in range(polynomial.g.shape[0]):
        share -= polynomial.g[term]
    return share


@kernel
def _add_slope(polynomial: PolynomialMembrane, factor: float) -> None:
    """Add ``factor`` times the slope at the place, that of what lags included."""
    _add_own_slope(polynomial, polynomial.place, factor * _lasts(polynomial))
    for term in range(polynomial.g.shape[0]):
        _add_own_slope(polynomial, _gap(polynomial, term), factor * polynomial.g[term])


@kernel
def _add_tangent(polynomial: PolynomialMembrane, factor: float) -> None:
    """Add ``factor`` times the tangent at the place, that of what lags included, times ``searched``."""
    _add_own_tangent(polynomial, polynomial.place, factor * _lasts(polynomial))
    for term in range(polynomial.g.shape[0]):
        _add_own_tangent(polynomial, _gap(polynomial, term), factor * polynomial.g[term])


@kernel
def _add_own_slope(polynomial: PolynomialMembrane, x: FloatArray, factor: float) -> None:
    """Add ``factor`` times the polynomial at x (s,): monomials in the outer loops, what they make in the innermost."""
    out, pair, triple = polynomial.out, 0, 0
    for j in range(x.shape[0]):
        for k in range(j, x.shape[0]):
            product = factor * x[j] * x[k]
            for i in range(out.shape[0]):
                out[i] += product * polynomial.quadratic[pair, i]
            pair += 1
            for other in range(k, x.shape[0]):
                monomial = product * x[other]
                for i in range(out.shape[0]):
                    out[i] += monomial * polynomial.cubic[triple, i]
                triple += 1


@kernel
def _add_own_tangent(polynomial: PolynomialMembrane, x: FloatArray, factor: float) -> None:
    """Add ``factor`` times the derivative of the polynomial at x (s,) along ``searched``."""
    out, v, pair, triple = polynomial.out, polynomial.searched, 0, 0
    for j in range(x.shape[0]):
        for k in range(j, x.shape[0]):
            product, change = factor * x[j] * x[k], factor * (v[j] * x[k] + x[j] * v[k])
            for i in range(out.shape[0]):
                out[i] += change * polynomial.quadratic[pair, i]
            pair += 1
            for other in range(k, x.shape[0]):
                monomial = change * x[other] + product * v[other]
                for i in range(out.shape[0]):
                    out[i] += monomial * polynomial.cubic[triple, i]
                triple += 1


@kernel
def _energy(polynomial: PolynomialMembrane, x: FloatArray) -> float:
    """Return the energy at x (s,): by Euler's theorem a third and a quarter of the work of either part's slope."""
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
