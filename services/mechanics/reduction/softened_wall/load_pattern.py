"""A pattern of loads and the potential that belongs to it: a function of one number, the modes' displacement along it.

For loads theta a on the sites, m the modal force of a, the law says that the wall gives way by theta^2 V Y(theta rho)
of work beyond the linear one. The force phi n on the modes, n = K t, moves them by phi t beyond the linear response,
so that s = n . (q - q_rest) is theta (m . t) + phi (t . K t), and phi = theta Y(theta rho) g with g = V / (m . t) does
that work. phi is a function of s alone: the force has the potential

    P(s) = -integral of phi ds = -((m . t) g A(theta rho) / rho^2 + phi^2 (t . K t) / 2),  A(x) = integral of x Y(x) dx.

Where the wall gives way (rho > 0) phi grows with s: P is concave, and the tangent K - phi' n n is positive definite at
any s, as phi' (t . K t) < 1. All is homogeneous in a: only the shape of a pattern counts, never its size. A law may
turn: beside a support the wall first gives way to a poke and then is stretched by it, and phi falls again, beyond zero.
A wall that is pulled out (rho < 0) is convex from the start.

So a pattern is a term of the wall that reads one number, s.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct

LINEAR, DELIVERED, GAIN, RHO, PART, TURN = range(6)
"""Numbers of a pattern: m . t and t . K t in J, g, rho, how much of its potential acts, which is 1 unless it stiffens,
and the rho beyond which phi falls: zero where rho is negative, infinite where phi never falls."""
N_NUMBERS = TURN + 1  # as many as are named above
MOST_SOFTENING = 0.9
"""Largest part of the linear stiffness that may be lost along a pattern; the rest brings the wall back."""
MOST_STIFFENING = 0.8
"""Of the linear stiffness, that a wall pulled outward may take on beside it: s stays a growing function of theta."""
MOST_TURNED = 0.95
"""The same of a wall whose law has turned."""
BISECTIONS = 48  # halves of the largest load: 2^-48 is 4e-15, less than `PRECISION`
SHORT = 1e-4
"""Of a displacement: on a shorter way the difference of the potential has fewer digits than the slope at its middle."""
PRECISION = 1e-14
"""Of the size of a load that displaces as far as the wall is."""


class Pattern(Struct):
    """What a pattern of loads comes to; its law over p points of rho."""

    direction: Annotated[FloatArray, "r"]  # n, in N per unit phi
    work: Annotated[FloatArray, "p"]  # Y
    area: Annotated[FloatArray, "p"]  # A
    numbers: Annotated[FloatArray, N_NUMBERS]
    faded: Annotated[FloatArray, 1]  # part of the potential that does not act
    tangent: Annotated[FloatArray, 1]  # second derivative of what acts, summed over a way
    rho_first: float = 0.0
    rho_step: float = 1.0

    def state_arrays(self) -> tuple[FloatArray, ...]:
        """Return the live arrays of the state."""
        return self.direction, self.work, self.area, self.numbers, self.faded


@kernel
def copy_pattern(source: Pattern, target: Pattern) -> None:
    """Copy one pattern over another."""
    for mode in range(source.direction.shape[0]):
        target.direction[mode] = source.direction[mode]
    for point in range(source.work.shape[0]):
        target.work[point] = source.work[point]
        target.area[point] = source.area[point]
    for number in range(N_NUMBERS):
        target.numbers[number] = source.numbers[number]


@kernel
def read_law(pattern: Pattern, rho: float) -> tuple[float, float]:
    """Return Y, straight between the points and constant beyond them, and A, exactly its integral.

    Where a law that has turned ends above nothing it is rho Y that is constant beyond, which is not to grow again.
    """
    first, step, last = pattern.rho_first, pattern.rho_step, pattern.work.shape[0] - 1
    point = min(max(int((rho - first) / step), 0), last - 1)
    start = first + point * step
    inside = min(max(rho, first), first + last * step)
    slope = (pattern.work[point + 1] - pattern.work[point]) / step
    work = pattern.work[point] + slope * (inside - start)
    area = pattern.area[point] + _area(pattern.work[point], slope, start, inside)
    if rho > inside and work > 0.0 and pattern.numbers[TURN] < math.inf:
        return work * inside / rho, area + work * inside * (rho - inside)
    return work, area + 0.5 * work * (rho - inside) * (rho + inside)


@kernel
def slope_of_load(pattern: Pattern, rho: float) -> float:
    """Return the derivative of rho Y(rho) by rho."""
    first, step, last = pattern.rho_first, pattern.rho_step, pattern.work.shape[0] - 1
    if rho < first:
        return float(pattern.work[0])
    if rho > first + last * step:
        return 0.0 if pattern.work[last] > 0.0 and pattern.numbers[TURN] < math.inf else float(pattern.work[last])
    point = min(int((rho - first) / step), last - 1)
    slope = (pattern.work[point + 1] - pattern.work[point]) / step
    return float(pattern.work[point] + slope * (2.0 * rho - first - point * step))


@kernel
def _area(work: float, slope: float, start: float, end: float) -> float:
    """Return the integral of x (work + slope (x - start)) dx from start to end."""
    squares = (end - start) * (end + start)
    cubes = (end - start) * (end * end + end * start + start * start)
    return 0.5 * (work - slope * start) * squares + slope * cubes / 3.0


@kernel
def integrate_law(pattern: Pattern) -> None:
    """Write A of the points, zero where rho is."""
    work, area, step = pattern.work, pattern.area, pattern.rho_step
    zero = _zero(pattern)
    area[zero] = 0.0
    for point in range(zero, area.shape[0] - 1):
        rho, slope = pattern.rho_first + point * step, (work[point + 1] - work[point]) / step
        area[point + 1] = area[point] + _area(work[point], slope, rho, rho + step)
    for point in range(zero - 1, -1, -1):
        rho, slope = pattern.rho_first + point * step, (work[point + 1] - work[point]) / step
        area[point] = area[point + 1] - _area(work[point], slope, rho, rho + step)


@kernel
def turns(pattern: Pattern) -> bool:
    """Whether the law of a wall that is pressed in turns: at the largest rho that was learned the wall is stretched.

    Less than that is how the law goes on where nothing was learned. It is no matter of how far the wall is pressed:
    a pattern that turned late would store more than the one before it, which would stay.
    """
    return bool(pattern.numbers[RHO] > 0.0 and pattern.work[pattern.work.shape[0] - 1] < 0.0)


@kernel
def bound_law(pattern: Pattern) -> None:
    """Hold the slope of the law within bounds, given the other numbers of the pattern; write where it turns.

    Where rho is positive, rho Y grows with it, so that P is concave, and not so fast that more than `MOST_SOFTENING`
    of the linear stiffness is lost along the pattern; a law that `turns` falls from there on, and no more than
    `MOST_TURNED` comes to the linear stiffness. Where rho is negative, Y is too, likewise.
    """
    numbers, work, zero = pattern.numbers, pattern.work, _zero(pattern)
    unit = numbers[LINEAR] / (numbers[DELIVERED] * numbers[GAIN])
    may_turn = turns(pattern)
    work[zero] = 0.0
    softest, turned = unit * MOST_SOFTENING / (1.0 - MOST_SOFTENING), unit * MOST_TURNED
    numbers[TURN] = math.inf if numbers[RHO] > 0.0 else 0.0
    for point in range(zero + 1, work.shape[0]):
        ratio, before = float(point - zero), work[point - 1]
        constant = _constant(before, ratio)
        if may_turn and ratio > 1.0 and work[point] < constant and numbers[TURN] == math.inf:
            numbers[TURN] = (ratio - 1.0) * pattern.rho_step
        if numbers[TURN] == math.inf or numbers[TURN] == 0.0:
            work[point] = max(min(work[point], _steepest(before, ratio, softest)), constant)
        else:
            least = (ratio * before - turned) / (1.0 + ratio)
            work[point] = min(max(work[point], least), constant, before * (ratio - 2.0) / (ratio - 1.0))
    most = unit * MOST_STIFFENING
    for point in range(zero - 1, -1, -1):
        steepest = _steepest(-work[point + 1], float(zero - point), most)
        work[point] = -max(min(-work[point], steepest), 0.0)


@kernel
def _steepest(work: float, ratio: float, most: float) -> float:
    """Return the largest next Y at which the slope of rho Y is at most ``most``; ``ratio`` is rho over the step."""
    return min((most + work * ratio) / (1.0 + ratio), most)


@kernel
def _constant(work: float, ratio: float) -> float:
    """Return the next Y at which the slope of rho Y ends in zero; ``ratio`` is rho over the step."""
    return work * ratio / (ratio + 1.0)


@kernel
def _zero(pattern: Pattern) -> int:
    """Return the point of the law where rho is zero."""
    return int(-pattern.rho_first / pattern.rho_step + 0.5)


@kernel
def pattern_energy(pattern: Pattern, s: float) -> float:
    """Return the potential at ``s``, as much of it as acts."""
    return _acting(pattern) * evaluate(pattern, s)[1] if pattern.numbers[GAIN] != 0.0 else 0.0


@kernel
def add_pattern_slope(pattern: Pattern, s: float, weights: tuple[float, float], out: FloatArray) -> float:
    """Add the slope at ``s`` to ``out`` (1,), and the second derivative to that of the pattern, by ``weights``.

    Return the potential, as much of it as acts.
    """
    if pattern.numbers[GAIN] == 0.0:
        return 0.0
    phi, potential, slope = evaluate(pattern, s)
    out[0] -= weights[0] * _acting(pattern) * phi
    pattern.tangent[0] -= weights[1] * _acting(pattern) * slope
    return _acting(pattern) * potential


@kernel
def add_mean_pattern_slope(pattern: Pattern, start: float, end: float, out: FloatArray) -> None:
    """Add the mean slope on the way from ``start`` to ``end`` to ``out`` (1,), and its derivative by the end.

    It is the fall of the potential over the way, so exact of any law; on a way that is short, the slope of its middle.
    """
    if abs(end - start) <= SHORT * (abs(start) + abs(end)):
        add_pattern_slope(pattern, 0.5 * (start + end), (1.0, 0.5), out)
    elif pattern.numbers[GAIN] != 0.0:
        phi, after, _ = evaluate(pattern, end)
        mean = (after - evaluate(pattern, start)[1]) / (end - start)
        out[0] += _acting(pattern) * mean
        pattern.tangent[0] += _acting(pattern) * (-phi - mean) / (end - start)


@kernel
def _acting(pattern: Pattern) -> float:
    return float((1.0 - pattern.faded[0]) * pattern.numbers[PART])


@kernel
def evaluate(pattern: Pattern, s: float) -> tuple[float, float, float]:
    """Return phi, P and the derivative of phi at s; none for a wall that has moved the other way."""
    theta = _solve_theta(pattern, s, 1.0)
    if theta == 0.0:
        return 0.0, 0.0, 0.0
    numbers = pattern.numbers
    linear, delivered, rho = numbers[LINEAR], numbers[DELIVERED], numbers[RHO]
    work, area = read_law(pattern, theta * rho)
    phi = numbers[GAIN] * theta * work
    by_theta = numbers[GAIN] * slope_of_load(pattern, theta * rho)
    slope = by_theta / (linear + by_theta * delivered)
    return phi, -(linear * numbers[GAIN] * area / (rho * rho) + 0.5 * phi * phi * delivered), slope


@kernel
def conjugate(pattern: Pattern, s: float) -> float:
    """Return the largest h . p - W(p) less that of a linear wall, which h would move by ``s`` along the pattern.

    W is the energy of the linear wall with the pattern, ``PART`` of it.
    """
    numbers = pattern.numbers
    if not s > 0.0 or numbers[GAIN] == 0.0 or numbers[PART] == 0.0:
        return 0.0
    part, linear, rho = numbers[PART], numbers[LINEAR], numbers[RHO]
    theta = s / linear if part == 1.0 else _solve_theta(pattern, s, 1.0 - part)
    work, area = read_law(pattern, theta * rho)
    phi = numbers[GAIN] * theta * work
    energy = linear * numbers[GAIN] * area / (rho * rho) + 0.5 * (1.0 - part) * phi * phi * numbers[DELIVERED]
    return float(part * energy)


@kernel
def _solve_theta(pattern: Pattern, s: float, share: float) -> float:
    """Return the theta at which the displacement is ``s``, of which phi makes ``share`` of its own; 0 of no pattern.

    Between bounds, by Newton's method where that stays within them.
    """
    numbers = pattern.numbers
    linear, delivered, rho, gain = numbers[LINEAR], numbers[DELIVERED], numbers[RHO], numbers[GAIN]
    if not s > 0.0 or gain == 0.0:
        return 0.0
    low, high = 0.0, s / linear
    if numbers[TURN] < math.inf:
        high /= 1.0 - MOST_STIFFENING if numbers[TURN] == 0.0 else 0.5 * (1.0 - MOST_TURNED)
    theta = 0.5 * high
    for _ in range(BISECTIONS):
        left = theta * (linear + share * delivered * gain * read_law(pattern, theta * rho)[0]) - s
        if left < 0.0:
            low = theta
        else:
            high = theta
        before = theta
        theta -= left / (linear + share * delivered * gain * slope_of_load(pattern, theta * rho))
        if not low < theta < high:
            theta = 0.5 * (low + high)
        if abs(theta - before) <= PRECISION * theta:
            break
    return float(theta)
