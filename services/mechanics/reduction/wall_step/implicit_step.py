r"""One implicit step for the sum of the wall's terms: a force that is held over it and does the work of the potential.

A term is a function w of a few readings x = B q + b of the wall's coordinates q: the strains of its samples, the lowest
modes, the displacement along a pattern of loads. It tells its energy, slope and second derivatives there; energy, force
and tangent of the wall follow (`wall_energy`, `wall_force`, `wall_tangent_times`).

The force f that is held over the step from q to x is the mean slope of the potential W on the straight way there,

.. math:: f = -\int_0^1 W'(q + s (x - q))\, ds,

at Gauss' two points, and exactly of a pattern. It does the work f (x - q) = W(q) - W(x), exactly of a quartic: nothing
is gained and nothing lost at any length of step, whether W is convex or not (the averaged vector field: Quispel and
McLaren, Journal of Physics A 41:045206, 2008). It is of second order, as the linear modes' step is.

The modes end at x = p + G f, with p their end without f and G what a held force moves them by. With
h = G^{-1/2} (x - p) that is where |h|^2 / 2 + integral of W(q + s (x - q)) / s ds is least, which is strictly convex
where W with the linear wall's energy is. Newton's method with conjugate gradients, begun where the last two forces
point, takes the readings once an iteration, in single precision.

p assumes the contact forces of the last step. At rest the force is then exactly that of the terms. Where contacts
change, as where the wall is let go, the step ends elsewhere; `settle_step` corrects that.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, Float32Array, FloatArray
from trocar.services.mechanics.compiled import kernel, summing_kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples
from trocar.services.mechanics.reduction.nonlinear.membrane_polynomial import MembranePolynomial
from trocar.services.mechanics.reduction.softened_wall.load_pattern import (
    DELIVERED,
    GAIN,
    Pattern,
    add_mean_pattern_slope,
    add_pattern_slope,
)
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries, follow
from trocar.services.mechanics.reduction.wall_step.polynomial_membrane import (
    PolynomialMembrane,
    add_polynomial_slope,
    add_polynomial_tangent,
)
from trocar.services.mechanics.reduction.wall_step.sampled_membrane import (
    SampledMembrane,
    add_membrane_slope,
    add_membrane_tangent,
)

POINTS = (0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0))
"""Gauss' points on the way of a step, of equal weight: they integrate cubics exactly."""
NEWTON_STEPS = 4
"""At most; one or two are usual."""
GRADIENT_STEPS = 4
SEARCH_STEPS = 6
RELATIVE = 1e-4
"""Error over the force at which Newton's method ends, in the norm that 1 + H makes, H the second derivative. Where it
begins the residual stands for it, which is no smaller."""
SLACK = 0.1
"""Part of a step's error that conjugate gradients, or the search along it, may leave."""
TRUSTED = 0.01
"""Square of a step over that of the pull up to which Newton's step is taken whole: it errs by the square of what it
moves. So it is where the wall goes on as it went."""
LEAST_GAIN = 1e-6
"""Least gain over the largest one: an exact oscillator whose half period divides the step would have none."""
CREDIT_J = 1e-9
"""Debt that the tank may have: the work of 1 mN over 1 um."""
TANK_SHARE = 0.02
"""Largest content of the tank over the size of the stored energy, which may be below that of a linear wall; what steps
lose beyond it is dissipated. Where half of a wall's energy is the terms', the tank gives out at most 1 % of it."""
ENERGY, TANK, LAGGED, OF_MEMBRANE = range(4)
"""Places in the books: the energy where the last step ended, what steps have lost of it, the work of what lags, and how
much of the energy is the membrane's."""


class WallStep(Struct):
    """The terms, r modes and n readings, first the samples' strains, then the polynomial's, last the pattern's.

    Coordinates y are scaled such that a mode is root y. There are t terms of a Prony series, see `relax_wall`.
    """

    membrane: SampledMembrane
    polynomial: PolynomialMembrane
    pattern: Pattern
    rows: Annotated[Float32Array, "n", "r"]  # B; halves what is read, and all is of the same rounded rows
    offset: Annotated[FloatArray, "n"]  # b
    stiffness: Annotated[FloatArray, "r"]  # of the linear wall
    rest: Annotated[FloatArray, "r"]  # modal coordinates that the pattern's displacement counts from
    root: Annotated[FloatArray, "r"]
    pull: Annotated[FloatArray, "r"]  # state: root times the force that is held
    before: Annotated[FloatArray, "r"]  # state: the same of the step before
    residual: Annotated[Float32Array, "r"]
    step: Annotated[Float32Array, "r"]
    search: Annotated[Float32Array, "r"]
    image: Annotated[Float32Array, "r"]
    start: Annotated[FloatArray, "n"]  # state: readings where the step begins
    start_slope: Annotated[FloatArray, "n"]  # state: the slope of the terms there
    at: Annotated[FloatArray, "n"]  # where it ends
    along: Annotated[FloatArray, "n"]
    searched: Annotated[FloatArray, "n"]
    place: Annotated[FloatArray, "n"]
    slope: Annotated[FloatArray, "n"]
    books: Annotated[FloatArray, 4]  # state
    known: Annotated[FloatArray, "r"]  # state: modal coordinates that the energy in the books is of
    g: Annotated[FloatArray, "t"]
    lag: Annotated[FloatArray, "t", "r"]  # state: slopes that follow that of the terms
    lagging: Annotated[FloatArray, "r"]  # state: the force by which what lags pushes

    @classmethod
    def of(
        cls,
        stiffness: FloatArray,
        samples: StretchSamples | None = None,
        polynomial: MembranePolynomial | None = None,
        series: PronySeries = NEVER,
        pattern: Pattern | None = None,
    ) -> WallStep:
        """Take terms on, at rest, beside modes of ``stiffness`` (r,); `take_gain` comes before the first step.

        ``series`` is how the wall relaxes, if it does: all of it by the same. ``pattern`` is changed by its owner.
        """
        n_modes, lowest = len(stiffness), PolynomialMembrane.of(polynomial)
        terms = {
            "membrane": SampledMembrane.of(samples),
            "polynomial": lowest,
            "pattern": Pattern.zeros(r=n_modes, p=0) if pattern is None else pattern,
        }
        strains = np.zeros((0, n_modes)) if samples is None else samples.strain
        rows = np.concatenate([strains, np.eye(n_modes)[lowest.coordinates], np.zeros((1, n_modes))])
        extents = {"r": n_modes, "n": len(rows), "t": len(series.g)}
        arrays = {"rows": rows.astype(np.float32), "stiffness": stiffness, "g": np.array(series.g, np.float64)}
        return cls.zeros(**terms, **extents, **arrays)

    def take_gain(self, gain: FloatArray) -> None:
        """Prepare for steps in which a held force f moves the modes by ``gain`` (r,) times f."""
        root = np.sqrt(np.maximum(gain, LEAST_GAIN * gain.max()))
        for pull in (self.pull, self.before):
            pull *= np.divide(root, self.root, out=np.zeros_like(root), where=self.root > 0.0)
        self.root[:] = root

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        own = self.pull, self.before, self.books, self.known, self.start, self.start_slope, self.lag, self.lagging
        first = 3 * len(self.membrane.energy)
        of_pattern = self.rows[first:], self.offset
        return *own, *of_pattern, *self.membrane.state_arrays(), *self.pattern.state_arrays()


wall_at = reader(WallStep)


@kernel
def pushes(wall: WallStep, held: FloatArray) -> bool:
    """Whether anything could push: a term but for a pattern that is not there, what lags, or what was ``held`` (r,)."""
    if wall.membrane.energy.shape[0] + wall.polynomial.coordinates.shape[0] > 0 or wall.pattern.numbers[GAIN] != 0.0:
        return True
    for mode in range(held.shape[0]):
        if held[mode] != 0.0 or wall.lagging[mode] != 0.0 or wall.pull[mode] != 0.0:
            return True
    return False


@kernel
def place_pattern(wall: WallStep) -> None:
    """Write the readings of the pattern that acts, and of the polynomial: modes less how far they follow the pattern.

    What the pattern moves, t s / (t . K t), has the energy that the pattern's law says; the polynomial is that of the
    rest of the motion, or it would count twice.
    """
    last, first = wall.rows.shape[0] - 1, 3 * wall.membrane.energy.shape[0]
    pattern, at_rest = wall.pattern, 0.0
    acts = 1.0 if pattern.numbers[GAIN] != 0.0 else 0.0
    for mode in range(wall.root.shape[0]):
        n = acts * pattern.direction[mode]
        at_rest += n * wall.rest[mode]
        wall.rows[last, mode] = n
    wall.offset[last] = -at_rest
    for i in range(wall.polynomial.coordinates.shape[0]):
        own = wall.polynomial.coordinates[i]
        share = following_share(wall, pattern, own)
        for mode in range(wall.root.shape[0]):
            wall.rows[first + i, mode] = (1.0 if mode == own else 0.0) - share * pattern.direction[mode]
        wall.offset[first + i] = share * at_rest


@kernel
def read_pattern(wall: WallStep, q: FloatArray) -> float:
    """Note anew, where a step begins at ``q`` (r,), what depends on the pattern; return the energy there."""
    first, last = 3 * wall.membrane.energy.shape[0], wall.rows.shape[0] - 1
    for i in range(first, last + 1):
        wall.start[i], wall.start_slope[i] = wall.offset[i], 0.0
        for mode in range(q.shape[0]):
            wall.start[i] += wall.rows[i, mode] * q[mode]
    x, out, at_place = wall.start, wall.start_slope, (1.0, 0.0)
    of_polynomial = add_polynomial_slope(wall.polynomial, x[first:last], at_place, out[first:last])
    of_pattern = add_pattern_slope(wall.pattern, x[last], at_place, out[last:])
    return float(wall.books[OF_MEMBRANE] + of_polynomial + of_pattern)


@kernel
def replace_terms(address: Address[WallStep], q: FloatArray) -> None:
    """Note that terms have changed, at modal coordinates (r,)."""
    wall = wall_at(address)
    place_pattern(wall)
    wall.books[ENERGY] = begin_step(wall, q)


@kernel
def following_share(wall: WallStep, pattern: Pattern, mode: int) -> float:
    """Return how far a mode moves with a pattern, over the displacement along that."""
    delivered = pattern.numbers[DELIVERED]
    if pattern.numbers[GAIN] == 0.0:
        return 0.0
    return float((1.0 - pattern.faded[0]) * pattern.direction[mode] / wall.stiffness[mode] / delivered)


@kernel
def wall_energy(address: Address[WallStep], q: FloatArray) -> float:
    """Return the energy of all terms at modal coordinates (r,), in J."""
    wall = wall_at(address)
    _read(wall, q)
    _begin_slope(wall)
    return _add_every_slope(wall, (1.0, 0.0))[0]


@kernel
def wall_force(address: Address[WallStep], q: FloatArray, out: FloatArray) -> None:
    """Subtract the slope of the energy at modal coordinates (r,) from ``out`` (r,)."""
    wall = wall_at(address)
    _read(wall, q)
    _begin_slope(wall)
    _add_every_slope(wall, (1.0, 0.0))
    _spread(wall.rows, wall.slope, -1.0, out)


@kernel
def wall_tangent_times(address: Address[WallStep], q: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Add the second derivative of the energy at ``q`` (r,), times ``v`` (r,), to ``out`` (r,)."""
    wall = wall_at(address)
    _read(wall, q)
    _begin_slope(wall)
    _add_every_slope(wall, (0.0, 1.0))
    _multiply(wall.rows, v, wall.searched)
    _tangent_times(wall, wall.searched)
    _spread(wall.rows, wall.slope, 1.0, out)


@kernel
def _read(wall: WallStep, q: FloatArray) -> None:
    """Write the readings at modal coordinates (r,)."""
    _multiply(wall.rows, q, wall.place)
    for i in range(wall.place.shape[0]):
        wall.place[i] += wall.offset[i]


@kernel
def _begin_slope(wall: WallStep) -> None:
    wall.slope[:] = 0.0
    wall.membrane.tangent[:] = 0.0
    wall.polynomial.tangent[:] = 0.0
    wall.pattern.tangent[0] = 0.0


@kernel
def _add_slope(wall: WallStep, weights: tuple[float, float]) -> tuple[float, float]:
    """Add the slope at the place, and the second derivatives, by ``weights``: of the terms but for the pattern.

    Return the energies of the membrane and of the polynomial, in J.
    """
    x, out = wall.place, wall.slope
    first, last = 3 * wall.membrane.energy.shape[0], x.shape[0] - 1
    of_membrane = add_membrane_slope(wall.membrane, x, weights, out)
    return of_membrane, add_polynomial_slope(wall.polynomial, x[first:last], weights, out[first:last])


@kernel
def _add_every_slope(wall: WallStep, weights: tuple[float, float]) -> tuple[float, float]:
    """Add the same of all terms; return the energy of all, and of the membrane."""
    last = wall.place.shape[0] - 1
    of_membrane, of_polynomial = _add_slope(wall, weights)
    of_pattern = add_pattern_slope(wall.pattern, wall.place[last], weights, wall.slope[last:])
    return of_membrane + of_polynomial + of_pattern, of_membrane


@kernel
def _tangent_times(wall: WallStep, v: FloatArray) -> None:
    """Write the second derivatives times ``v`` (n,) over the slope."""
    out = wall.slope
    first, last = 3 * wall.membrane.energy.shape[0], out.shape[0] - 1
    out[:] = 0.0
    add_membrane_tangent(wall.membrane, v, out)
    add_polynomial_tangent(wall.polynomial, v[first:last], out[first:last])
    out[last] = wall.pattern.tangent[0] * v[last]


@kernel
def _add_mean_slope(wall: WallStep, length: float) -> None:
    """Write the mean slope on the way to ``at`` and a part of ``along`` more, and its derivatives by the end."""
    _begin_slope(wall)
    for point in POINTS:
        for i in range(wall.place.shape[0]):
            start = wall.start[i]
            wall.place[i] = start + point * (wall.at[i] + length * wall.along[i] - start)
        _add_slope(wall, (0.5, 0.5 * point))
    last = wall.place.shape[0] - 1
    end = wall.at[last] + length * wall.along[last]
    add_mean_pattern_slope(wall.pattern, wall.start[last], end, wall.slope[last:])


@kernel
def held_force(address: Address[WallStep], start: FloatArray, free_end: FloatArray, out: FloatArray) -> None:
    """Write the modal force (r,) that is to be held over a step from ``start`` (r,).

    ``free_end`` (r,) is where the modes come without it, with the contact forces that are expected.
    """
    wall = wall_at(address)
    _know(wall, start)
    _extrapolate(wall.pull, wall.before)
    for mode in range(wall.root.shape[0]):
        wall.image[mode] = free_end[mode] + wall.root[mode] * wall.pull[mode]
    _multiply(wall.rows, wall.image, wall.at)
    for i in range(wall.at.shape[0]):
        wall.at[i] += wall.offset[i]
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
            wall.books[ENERGY] = begin_step(wall, q)
            break


@kernel
def begin_step(wall: WallStep, q: FloatArray) -> float:
    """Note where a step begins, and return the energy there."""
    wall.known[:] = q
    _read(wall, q)
    _begin_slope(wall)
    energy, wall.books[OF_MEMBRANE] = _add_every_slope(wall, (1.0, 0.0))
    wall.start[:] = wall.place
    wall.start_slope[:] = wall.slope
    return energy


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
def energy_and_loss(
    address: Address[WallStep], force: FloatArray, q_start: FloatArray, q: FloatArray
) -> tuple[float, float]:
    """Return the energy at ``q`` (r,), and by how much it fell more than ``force`` (r,) has worked from ``q_start``."""
    wall, work = wall_at(address), 0.0
    energy = begin_step(wall, q)
    for mode in range(q.shape[0]):
        work += force[mode] * (q[mode] - q_start[mode])
    return energy, wall.books[ENERGY] - energy - work


@kernel
def balance_step(
    address: Address[WallStep], force: FloatArray, q_start: FloatArray, q: FloatArray
) -> tuple[float, float, float]:
    """Do as `energy_and_loss`, and enter that where the tank covers it; return what the tank held as well."""
    wall = wall_at(address)
    energy, lost = energy_and_loss(address, force, q_start, q)
    tank = wall.books[TANK]
    if tank + lost >= -CREDIT_J:
        wall.books[ENERGY] = energy
        wall.books[TANK] = min(tank + lost, TANK_SHARE * abs(energy))
    return energy, lost, tank


@kernel
def relax_wall(address: Address[WallStep], q_start: FloatArray, q: FloatArray, decay: FloatArray) -> None:
    """Let what lags follow the slope of the terms at the end ``q`` (r,) of a step by the factors ``decay`` (t,).

    The force of a wall that relaxes is N(q) - sum_k g_k h_k, N the slope of its energy W and h_k' = (N - h_k) / tau_k
    (quasi-linear viscoelasticity: Y. C. Fung, Biomechanics, 1993, 7.6): whatever its laws, it relaxes by the series. It
    stores

        W(q) + sum_k g_k (W*(h_k) - h_k . q),  W*(h) the largest h . p - W(p),

    which is (1 - sum g) W(q) + sum_k g_k (W(q) - W(p_k) - N(p_k) . (q - p_k)) where h_k = N(p_k), and of a quadratic W
    (1 - sum g) W(q) + sum_k g_k W(q - p_k). Its slope by q is the force, and where W is convex it falls in any h that
    goes a part of the way to N. What lags of the linear wall is in `ViscousModes`; this is the rest, that of the terms.
    """
    wall = wall_at(address)
    for mode in range(q.shape[0]):
        wall.books[LAGGED] += wall.lagging[mode] * (q[mode] - q_start[mode])
    _know(wall, q)
    slope = wall.lagging
    wall.image[:] = 0.0
    _spread(wall.rows, wall.start_slope, 1.0, wall.image)
    for mode in range(q.shape[0]):
        slope[mode] = wall.image[mode]
    for term in range(wall.g.shape[0]):
        follow(wall.lag[term], slope, decay[term])
    acts = acting_share(wall)
    slope[:] = 0.0
    for term in range(wall.g.shape[0]):
        for mode in range(q.shape[0]):
            if acts == 0.0:
                wall.lag[term, mode] = 0.0
            wall.lagging[mode] += acts * wall.g[term] * wall.lag[term, mode]


@kernel
def acting_share(wall: WallStep) -> float:
    """Return how much of what lags acts: none where all terms have faded."""
    if wall.polynomial.coordinates.shape[0] > 0:
        return 1.0
    of_membrane = 1.0 - wall.membrane.faded[0] if wall.membrane.energy.shape[0] > 0 else 0.0
    of_pattern = 1.0 - wall.pattern.faded[0] if wall.pattern.work.shape[0] > 0 else 0.0
    return float(max(of_membrane, of_pattern))


@kernel
def _newton_step(wall: WallStep) -> bool:
    """Take one step towards where the residual is zero; True when it is there."""
    residual, pull = wall.residual, wall.pull
    wall.along[:] = 0.0
    _add_mean_slope(wall, 0.0)
    residual[:] = 0.0
    _spread(wall.rows, wall.slope, -1.0, residual)
    size, wrong = 0.0, 0.0
    for mode in range(pull.shape[0]):
        residual[mode] = wall.root[mode] * residual[mode] - pull[mode]
        size += pull[mode] * pull[mode]
        wrong += residual[mode] * residual[mode]
    if wrong <= RELATIVE * RELATIVE * size:
        return True
    enough = (0.5 * RELATIVE) ** 2 * size
    decrement, error = _solve_tangent(wall, enough)
    length = 1.0 if decrement <= TRUSTED * size else _line_search(wall, SLACK * decrement)
    for mode in range(pull.shape[0]):
        pull[mode] += length * wall.step[mode]
    for i in range(wall.at.shape[0]):
        wall.at[i] += length * wall.along[i]
    return length == 1.0 and error + SLACK * SLACK * decrement <= enough


@kernel
def _solve_tangent(wall: WallStep, enough: float) -> tuple[float, float]:
    """Write the step (1 + H) step = residual, by conjugate gradients, and what it moves the readings by.

    Returns step (1 + H) step, and the square of the error that is left, as what the last iteration added to it
    estimates it (Hestenes and Stiefel 1952), or the residual, where that is smaller. They end where that is at most
    ``enough``, or `SLACK` of the step, and along a way on which the wall would snap (Steihaug 1983).
    """
    residual, step, search, image = wall.residual, wall.step, wall.search, wall.image
    step[:] = 0.0
    left = 0.0
    for mode in range(step.shape[0]):
        search[mode] = residual[mode]
        left += residual[mode] * residual[mode]
    decrement, error = 0.0, left
    for _ in range(GRADIENT_STEPS):
        for mode in range(step.shape[0]):
            image[mode] = wall.root[mode] * search[mode]
        _multiply(wall.rows, image, wall.searched)
        _tangent_times(wall, wall.searched)
        image[:] = 0.0
        _spread(wall.rows, wall.slope, 1.0, image)
        curvature = 0.0
        for mode in range(step.shape[0]):
            image[mode] = search[mode] + wall.root[mode] * image[mode]
            curvature += search[mode] * image[mode]
        if not curvature > 0.0:
            break
        length, before = left / curvature, left
        left = 0.0
        for mode in range(step.shape[0]):
            step[mode] += length * search[mode]
            residual[mode] -= length * image[mode]
            left += residual[mode] * residual[mode]
        for i in range(wall.along.shape[0]):
            wall.along[i] += length * wall.searched[i]
        decrement += length * before
        error = min(length * before, left)
        if error <= max(enough, SLACK * SLACK * decrement):
            break
        for mode in range(step.shape[0]):
            search[mode] = residual[mode] + left / before * search[mode]
    return decrement, error


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
        slope, curvature = along_pull + length * along_itself, along_itself
        _add_mean_slope(wall, length)
        for i in range(wall.along.shape[0]):
            slope += wall.slope[i] * wall.along[i]
        _tangent_times(wall, wall.along)
        for i in range(wall.along.shape[0]):
            curvature += wall.slope[i] * wall.along[i]
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


# Both go through the rows by four: what they read again for each of them, and `_spread` writes, is then read once.
@summing_kernel
def _multiply(rows: Float32Array, v: AnyArray, out: FloatArray) -> None:
    """Write rows times ``v`` (r,) into ``out`` (n,), summed in the precision of the products."""
    whole, zero = rows.shape[0] // 4 * 4, v.dtype.type(0.0)
    for i in range(0, whole, 4):
        a, b, c, d = zero, zero, zero, zero
        for mode in range(v.shape[0]):
            a += rows[i, mode] * v[mode]
            b += rows[i + 1, mode] * v[mode]
            c += rows[i + 2, mode] * v[mode]
            d += rows[i + 3, mode] * v[mode]
        out[i], out[i + 1], out[i + 2], out[i + 3] = a, b, c, d
    for i in range(whole, rows.shape[0]):
        a = zero
        for mode in range(v.shape[0]):
            a += rows[i, mode] * v[mode]
        out[i] = a


@kernel
def _spread(rows: Float32Array, x: FloatArray, factor: float, out: AnyArray) -> None:
    """Add ``factor`` times rows, transposed, times ``x`` (n,) to ``out`` (r,)."""
    whole = rows.shape[0] // 4 * 4
    for i in range(0, whole, 4):
        a, b = out.dtype.type(factor * x[i]), out.dtype.type(factor * x[i + 1])
        c, d = out.dtype.type(factor * x[i + 2]), out.dtype.type(factor * x[i + 3])
        if a != 0.0 or b != 0.0 or c != 0.0 or d != 0.0:
            for mode in range(out.shape[0]):
                of_pairs = rows[i, mode] * a + rows[i + 1, mode] * b, rows[i + 2, mode] * c + rows[i + 3, mode] * d
                out[mode] += of_pairs[0] + of_pairs[1]
    for i in range(whole, rows.shape[0]):
        each = out.dtype.type(factor * x[i])
        for mode in range(out.shape[0]):
            out[mode] += rows[i, mode] * each
