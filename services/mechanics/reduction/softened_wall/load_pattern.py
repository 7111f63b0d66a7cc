"""A pattern of loads and the potential that belongs to it: a function of one number, the modes' displacement along it.

For loads theta a on the sites, m the modal force of a, the law says that the wall gives way by theta^2 V Y(theta rho)
of work beyond the linear one. The force phi n on the modes, n = K t, moves them by phi t beyond the linear response,
so that s = n . (q - q_rest) is theta (m . t) + phi (t . K t), and phi = theta Y(theta rho) g with g = V / (m . t) does
that work. phi is a function of s alone: the force has the potential

    P(s) = -integral of phi ds = -((m . t) g A(theta rho) / rho^2 + phi^2 (t . K t) / 2),  A(x) = integral of x Y(x) dx.

Where the wall gives way (rho > 0) phi grows with s: P is concave, and the tangent K - phi' n n is positive definite at
any s, as phi' (t . K t) < 1. All is homogeneous in a: only the shape of a pattern counts, never its size.

A law may turn: beside a support the wall first gives way to a poke and then is stretched by it, and phi falls again,
beyond zero. Then P is the sum of a concave part, whose force is phi up to where it turns and stays what it is there,
and of a convex one, whose force is the rest. A wall that is pulled out (rho < 0) is convex from the start.
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
N_NUMBERS = 6
MOST_STIFFENING = 0.8
"""Of the linear stiffness, that a wall pulled outward may take on beside it: s stays a growing function of theta."""
MOST_TURNED = 0.95
"""The same of a wall whose law has turned."""
BISECTIONS = 48


class Pattern(Struct):
    """What a pattern of loads comes to; its law over p points of rho."""

    direction: Annotated[FloatArray, "r"]  # n, in N per unit phi
    work: Annotated[FloatArray, "p"]  # Y
    area: Annotated[FloatArray, "p"]  # A
    numbers: Annotated[FloatArray, N_NUMBERS]
    rho_first: float
    rho_step: float

    def state_arrays(self) -> tuple[FloatArray, ...]:
        """Return the live arrays of the state."""
        return self.direction, self.work, self.area, self.numbers


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
def bound_law(pattern: Pattern, most_softening: float) -> None:
    """Hold the slope of the law within bounds, given the other numbers of the pattern; write where it turns.

    Where rho is positive, rho Y grows with it, so that P is concave, and not so fast that more than ``most_softening``
    of the linear stiffness is lost along the pattern; a law that `turns` falls from there on, and no more than
    `MOST_TURNED` comes to the linear stiffness. Where rho is negative, Y is too, likewise.
    """
    numbers, work, zero = pattern.numbers, pattern.work, _zero(pattern)
    unit = numbers[LINEAR] / (numbers[DELIVERED] * numbers[GAIN])
    may_turn = turns(pattern)
    work[zero] = 0.0
    softest, turned = unit * most_softening / (1.0 - most_softening), unit * MOST_TURNED
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
def evaluate(pattern: Pattern, s: float) -> tuple[float, float]:
    """Return phi and P at s; none for a wall that has moved the other way."""
    theta = _solve_theta(pattern, s, 0.0, 1.0)
    if theta == 0.0:
        return 0.0, 0.0
    numbers = pattern.numbers
    linear, rho = numbers[LINEAR], numbers[RHO]
    work, area = read_law(pattern, theta * rho)
    phi = numbers[GAIN] * theta * work
    return phi, -(linear * numbers[GAIN] * area / (rho * rho) + 0.5 * phi * phi * numbers[DELIVERED])


@kernel
def conjugate(pattern: Pattern, s: float) -> float:
    """Return W*(h) less that of the linear wall, which h would move by ``s`` along the pattern; see `relaxation`.

    Of a pattern of which only a part acts, part times P takes the place of P.
    """
    numbers = pattern.numbers
    if not s > 0.0 or numbers[GAIN] == 0.0 or numbers[PART] == 0.0:
        return 0.0
    part, linear, rho = numbers[PART], numbers[LINEAR], numbers[RHO]
    theta = s / linear if part == 1.0 else _solve_theta(pattern, s, 0.0, 1.0 - part)
    work, area = read_law(pattern, theta * rho)
    phi = numbers[GAIN] * theta * work
    energy = linear * numbers[GAIN] * area / (rho * rho) + 0.5 * (1.0 - part) * phi * phi * numbers[DELIVERED]
    return float(part * energy)


@kernel
def stiffens(pattern: Pattern) -> bool:
    """Whether there is a pattern whose potential has a convex part."""
    return bool(pattern.numbers[GAIN] != 0.0 and pattern.numbers[TURN] < math.inf)


@kernel
def evaluate_ahead(pattern: Pattern, s_start: float, s: float, moves: float) -> float:
    """Return what pushes in a step to s + ``moves`` times that, ``moves`` >= 0, of a pattern that stiffens.

    That is what has grown of phi at ``s_start``, where the step begins, and what has fallen of it where it ends: for
    either part of the potential no more work than it falls by.
    """
    grown = _grown(pattern, _solve_theta(pattern, s_start, 0.0, 1.0))
    theta = _solve_theta(pattern, s + moves * grown, moves, 1.0)
    return float(grown + _phi(pattern, theta) - _grown(pattern, theta))


@kernel
def _phi(pattern: Pattern, theta: float) -> float:
    """Return phi."""
    return float(pattern.numbers[GAIN] * theta * read_law(pattern, theta * pattern.numbers[RHO])[0])


@kernel
def _grown(pattern: Pattern, theta: float) -> float:
    """Return phi up to where it turns, and what it is there beyond."""
    numbers = pattern.numbers
    if numbers[TURN] == 0.0:
        return 0.0
    return _phi(pattern, min(theta, numbers[TURN] / numbers[RHO]))


@kernel
def _solve_theta(pattern: Pattern, s: float, moves: float, share: float) -> float:
    """Return the theta at which the displacement is s + ``moves`` times what has fallen of phi.

    0 where the wall has moved the other way. Of what phi moves the modes by, ``share`` counts.
    """
    numbers = pattern.numbers
    linear = numbers[LINEAR]
    if not s > 0.0 or numbers[GAIN] == 0.0:
        return 0.0
    low, high = 0.0, s / linear
    if numbers[TURN] < math.inf:
        high /= 1.0 - MOST_STIFFENING if numbers[TURN] == 0.0 else 0.5 * (1.0 - MOST_TURNED)
    for _ in range(BISECTIONS):
        theta = 0.5 * (low + high)
        phi = _phi(pattern, theta)
        fallen = phi - _grown(pattern, theta) if moves > 0.0 else 0.0
        if theta * linear + share * phi * numbers[DELIVERED] - moves * fallen < s:
            low = theta
        else:
            high = theta
    return float(0.5 * (low + high))
