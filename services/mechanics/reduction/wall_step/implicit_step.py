r"""One implicit step for the sum of the wall's terms: a force that is held over it and does the work of the potential.

The force f that is held over the step from q to x is the mean slope of the potential W on the straight way there,

.. math:: f = -\int_0^1 W'(q + s (x - q))\, ds,

at Gauss' two points. It does the work f (x - q) = W(q) - W(x), exactly of a quartic: nothing is gained and nothing lost
at any length of step, whether W is convex or not (the averaged vector field: Quispel and McLaren, Journal of Physics A
41:045206, 2008). It is of second order, as the linear modes' step is.

The modes end at x = p + G f, with p their end without f and G what a held force moves them by. With
h = G^{-1/2} (x - p) that is where |h|^2 / 2 + integral of W(q + s (x - q)) / s ds is least, which is strictly convex
where W with the linear wall's energy is. Newton's method with conjugate gradients, begun where the last two forces
point, reads the samples' strains once an iteration, in single precision.

p assumes the contact forces of the last step. At rest the force is then exactly that of the terms. Where contacts
change, as where the wall is let go, the step ends elsewhere; `settle_step` corrects that.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, Float32Array, FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples
from trocar.services.mechanics.reduction.nonlinear.cubic_force import CubicForce
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries
from trocar.services.mechanics.reduction.wall_step.polynomial_membrane import (
    PolynomialMembrane,
    add_polynomial_pull,
    add_polynomial_tangent,
    begin_polynomial,
    polynomial_energy,
    polynomial_slope_along,
    relax_polynomial,
    stretch_polynomial,
)
from trocar.services.mechanics.reduction.wall_step.sampled_membrane import (
    SampledMembrane,
    add_membrane_pull,
    add_membrane_tangent,
    begin_membrane,
    membrane_energy,
    membrane_slope_along,
    relax_membrane,
    stretch_membrane,
)

POINTS = (0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0))
"""Gauss' points on the way of a step, of equal weight: they integrate cubics exactly."""
NEWTON_STEPS = 4
"""At most; one or two are usual."""
GRADIENT_STEPS = 4
SEARCH_STEPS = 6
RELATIVE = 1e-3
"""Error over the force at which Newton's method ends, in the norm that 1 + H makes, H the second derivative. Where it
begins the residual stands for it, which is no smaller."""
SLACK = 0.1
"""Part of a step's error that conjugate gradients, or the search along it, may leave."""
TRUSTED = 0.01
"""Square of a step over that of the pull up to which Newton's step is taken whole: it errs by the square of what it
moves. So it is where the wall goes on as it went."""
LEAST_GAIN = 1e-6
"""Least gain over the largest one: an exact oscillator whose half period divides the step would have none."""
ENERGY, TANK = range(2)
"""Places in the books."""


class WallStep(Struct):
    """The terms, and r modes; coordinates y are scaled such that a mode is root y."""

    membrane: SampledMembrane
    polynomial: PolynomialMembrane
    root: Annotated[FloatArray, "r"]
    pull: Annotated[FloatArray, "r"]  # state: root times the force that is held
    before: Annotated[FloatArray, "r"]  # state: the same of the step before
    ahead: Annotated[FloatArray, "r"]
    residual: Annotated[Float32Array, "r"]
    step: Annotated[Float32Array, "r"]
    search: Annotated[Float32Array, "r"]
    image: Annotated[Float32Array, "r"]
    books: Annotated[FloatArray, 2]  # state: the energy, and what steps have lost of it
    known: Annotated[FloatArray, "r"]  # state: modal coordinates that the energy in the books is of

    @classmethod
    def of(
        cls,
        n_modes: int,
        samples: StretchSamples | None = None,
        polynomial: CubicForce | None = None,
        series: PronySeries = NEVER,
    ) -> WallStep:
        """Take terms on, at rest; `take_gain` comes before the first step.

        ``series`` is how the wall relaxes, if it does: all of it by the same.
        """
        membrane = SampledMembrane.of(samples, n_modes, series)
        return cls.zeros(membrane=membrane, polynomial=PolynomialMembrane.of(polynomial, series), r=n_modes)

    def take_gain(self, gain: FloatArray) -> None:
        """Prepare for steps in which a held force f moves the modes by ``gain`` (r,) times f."""
        root = np.sqrt(np.maximum(gain, LEAST_GAIN * gain.max()))
        for pull in (self.pull, self.before):
            pull *= np.divide(root, self.root, out=np.zeros_like(root), where=self.root > 0.0)
        self.root[:] = root
        for term in (self.membrane, self.polynomial):
            term.take_root(root)

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        return (
            self.pull,
            self.before,
            self.books,
            self.known,
            *self.membrane.state_arrays(),
            *self.polynomial.state_arrays(),
        )


wall_at = reader(WallStep)


@kernel
def held_force(address: Address[WallStep], start: FloatArray, free_end: FloatArray, out: FloatArray) -> None:
    """Write the modal force (r,) that is to be held over a step from ``start`` (r,).

    ``free_end`` (r,) is where the modes come without it, with the contact forces that are expected.
    """
    wall = wall_at(address)
    _know(wall, start)
    for mode in range(wall.root.shape[0]):
        wall.ahead[mode] = free_end[mode] / wall.root[mode]
    _extrapolate(wall.pull, wall.before)
    _stretch(wall)
    for _ in range(NEWTON_STEPS):
        if _newton_step(wall):
            break
    for mode in range(wall.root.shape[0]):
        out[mode] = wall.pull[mode] / wall.root[mode]


@kernel
def _know(wall: WallStep, q: FloatArray) -> None:
    """Begin at ``q`` (r,), where the last step has ended, unless somebody has put the wall elsewhere."""
    for mode in range(q.shape[0]):
        if wall.known[mode] != q[mode]:
            wall.books[ENERGY] = _begin(wall, q)
            break


@kernel
def _begin(wall: WallStep, q: FloatArray) -> float:
    """Note where a step begins, and return the energy there."""
    wall.known[:] = q
    begin_polynomial(wall.polynomial, q)
    return begin_membrane(wall.membrane, q) + polynomial_energy(wall.polynomial, q)


@kernel
def _extrapolate(pull: FloatArray, before: FloatArray) -> None:
    """Go on as the last two steps went, unless they differ by no more than errors do: a wall at rest would rattle."""
    moved, size = 0.0, 0.0
    for mode in range(pull.shape[0]):
        moved += (pull[mode] - before[mode]) ** 2
        size += pull[mode] * pull[mode]
    goes_on = 1.0 if moved > 4.0 * RELATIVE * RELATIVE * size else 0.0
    for mode in range(pull.shape[0]):
        last = pull[mode]
        pull[mode] += goes_on * (last - before[mode])
        before[mode] = last


@kernel
def wall_energy(address: Address[WallStep], q: FloatArray) -> float:
    """Return the energy of all terms at modal coordinates (r,), in J."""
    wall = wall_at(address)
    return _energy_of(wall, q)


@kernel
def _energy_of(wall: WallStep, q: FloatArray) -> float:
    return membrane_energy(wall.membrane, q) + polynomial_energy(wall.polynomial, q)


@kernel
def energy_and_loss(
    address: Address[WallStep], force: FloatArray, q_start: FloatArray, q: FloatArray
) -> tuple[float, float]:
    """Return the energy at ``q`` (r,), and by how much it fell more than ``force`` (r,) has worked from ``q_start``."""
    wall, work = wall_at(address), 0.0
    energy = _begin(wall, q)
    for mode in range(q.shape[0]):
        work += force[mode] * (q[mode] - q_start[mode])
    return energy, wall.books[ENERGY] - energy - work


@kernel
def relax_wall(address: Address[WallStep], q: FloatArray, decay: FloatArray) -> float:
    """Let what lags follow the modal coordinates (r,) by the factors ``decay`` (t,), and return the energy lost."""
    wall = wall_at(address)
    lost = relax_membrane(wall.membrane, q, decay) + relax_polynomial(wall.polynomial, q, decay)
    wall.books[ENERGY] -= lost
    return lost


@kernel
def _stretch(wall: WallStep) -> None:
    """Write where the terms are when the modes end with the pull."""
    end = wall.step
    for mode in range(end.shape[0]):
        end[mode] = wall.ahead[mode] + wall.pull[mode]
    stretch_membrane(wall.membrane, end)
    stretch_polynomial(wall.polynomial, end)


@kernel
def _newton_step(wall: WallStep) -> bool:
    """Take one step towards where the residual is zero; True when it is there."""
    residual, pull = wall.residual, wall.pull
    for mode in range(pull.shape[0]):
        residual[mode] = -pull[mode]
    wall.membrane.along[:] = 0.0
    wall.polynomial.along[:] = 0.0
    add_membrane_pull(wall.membrane, POINTS, residual)
    add_polynomial_pull(wall.polynomial, POINTS, residual)
    size, wrong = 0.0, 0.0
    for mode in range(pull.shape[0]):
        size += pull[mode] * pull[mode]
        wrong += residual[mode] * residual[mode]
    if wrong <= RELATIVE * RELATIVE * size:
        return True
    enough = (0.5 * RELATIVE) ** 2 * size
    decrement, last = _solve_tangent(wall, enough)
    length = 1.0 if decrement <= TRUSTED * size else _line_search(wall, SLACK * decrement)
    for mode in range(pull.shape[0]):
        pull[mode] += length * wall.step[mode]
    for i in range(wall.membrane.at.shape[0]):
        wall.membrane.at[i] += length * wall.membrane.along[i]
    for i in range(wall.polynomial.at.shape[0]):
        wall.polynomial.at[i] += length * wall.polynomial.along[i]
    return length == 1.0 and last + SLACK * SLACK * decrement <= enough


@kernel
def _solve_tangent(wall: WallStep, enough: float) -> tuple[float, float]:
    """Write the step (1 + H) step = residual, by conjugate gradients, and what it moves the terms by.

    Returns step (1 + H) step, and what the last iteration added to it: an estimate of the square of the error that is
    left (Hestenes and Stiefel 1952). They end where that is at most ``enough``, or `SLACK` of the step, and along a way
    on which the wall would snap (Steihaug 1983).
    """
    residual, step, search, image = wall.residual, wall.step, wall.search, wall.image
    step[:] = 0.0
    left = 0.0
    for mode in range(step.shape[0]):
        search[mode] = residual[mode]
        left += residual[mode] * residual[mode]
    decrement = last = 0.0
    for _ in range(GRADIENT_STEPS):
        for mode in range(step.shape[0]):
            image[mode] = search[mode]
        add_membrane_tangent(wall.membrane, search, image)
        add_polynomial_tangent(wall.polynomial, POINTS, search, image)
        curvature = 0.0
        for mode in range(step.shape[0]):
            curvature += search[mode] * image[mode]
        if not curvature > 0.0:
            break
        length, before = left / curvature, left
        left = 0.0
        for mode in range(step.shape[0]):
            step[mode] += length * search[mode]
            residual[mode] -= length * image[mode]
            left += residual[mode] * residual[mode]
        _go_along(wall.membrane.along, wall.membrane.searched, length)
        _go_along(wall.polynomial.along, wall.polynomial.searched, length)
        last = length * before
        decrement += last
        if last <= max(enough, SLACK * SLACK * decrement) or left == 0.0:
            break
        for mode in range(step.shape[0]):
            search[mode] = residual[mode] + left / before * search[mode]
    return decrement, last


@kernel
def _go_along(along: FloatArray, searched: FloatArray, length: float) -> None:
    for i in range(along.shape[0]):
        along[i] += length * searched[i]


@kernel
def _line_search(wall: WallStep, enough: float) -> float:
    """Return how far to go along the step, until the slope is at most ``enough``.

    It is Newton's method on a function of one number, within brackets.
    """
    along_pull, along_itself = 0.0, 0.0
    for mode in range(wall.pull.shape[0]):
        along_pull += wall.pull[mode] * wall.step[mode]
        along_itself += wall.step[mode] * wall.step[mode]
    low, high, length = 0.0, math.inf, 1.0
    for _ in range(SEARCH_STEPS):
        of_membrane = membrane_slope_along(wall.membrane, POINTS, length)
        of_polynomial = polynomial_slope_along(wall.polynomial, POINTS, length)
        slope = along_pull + length * along_itself + of_membrane[0] + of_polynomial[0]
        curvature = along_itself + of_membrane[1] + of_polynomial[1]
        if abs(slope) <= enough:
            break
        if slope > 0.0:
            high = length
        else:
            low = length
        length -= slope / curvature if curvature > 0.0 else 0.0
        if not low < length < high:
            length = 0.5 * (low + high) if high < math.inf else 2.0 * low
    return length
