"""A pattern of loads and the potential that belongs to it: a function of one number, the modes' displacement along it.

For loads theta a on the sites, m the modal force of a, the law says that the wall gives way by theta^2 V Y(theta rho)
of work beyond the linear one. The force phi n on the modes, n = K t, moves them by phi t beyond the linear response,
so that s = n . (q - q_rest) is theta (m . t) + phi (t . K t), and phi = theta Y(theta rho) g with g = V / (m . t) does
that work. phi is a function of s alone: the force has the potential

    P(s) = -integral of phi ds = -((m . t) g A(theta rho) / rho^2 + phi^2 (t . K t) / 2),  A(x) = integral of x Y(x) dx.

Where the wall gives way (rho > 0) phi grows with s: P is concave, and the tangent K - phi' n n is positive definite at
any s, as phi' (t . K t) < 1. All is homogeneous in a: only the shape of a pattern counts, never its size.
"""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Struct

LINEAR, DELIVERED, GAIN, RHO, PART = range(5)
"""Numbers of a pattern: m . t and t . K t in J, g, rho, and how much of its potential acts: 1 unless it stiffens."""
N_NUMBERS = 5
MOST_STIFFENING = 0.5
"""Of the linear stiffness, that a wall pulled outward may take on beside it: s stays a growing function of theta."""
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
    """Return Y, straight between the points and constant beyond them, and A, exactly its integral."""
    first, step, last = pattern.rho_first, pattern.rho_step, pattern.work.shape[0] - 1
    point = min(max(int((rho - first) / step), 0), last - 1)
    start = first + point * step
    inside = min(max(rho, first), first + last * step)
    slope = (pattern.work[point + 1] - pattern.work[point]) / step
    work = pattern.work[point] + slope * (inside - start)
    area = pattern.area[point] + _area(pattern.work[point], slope, start, inside)
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
def bound_law(pattern: Pattern, most_softening: float) -> None:
    """Hold the slope of the law within bounds, given the other numbers of the pattern.

    Where rho is positive, rho Y grows with it, so that P is concave, and not so fast that more than ``most_softening``
    of the linear stiffness is lost along the pattern; where it is negative, Y is too, and no more than
    `MOST_STIFFENING` comes to it.
    """
    numbers, work, zero = pattern.numbers, pattern.work, _zero(pattern)
    unit = numbers[LINEAR] / (numbers[DELIVERED] * numbers[GAIN])
    work[zero] = 0.0
    most = unit * most_softening / (1.0 - most_softening)
    for point in range(zero + 1, work.shape[0]):
        ratio = float(point - zero)
        least = work[point - 1] * ratio / (ratio + 1.0)
        work[point] = max(min(work[point], _steepest(work[point - 1], ratio, most)), least)
    most = unit * MOST_STIFFENING
    for point in range(zero - 1, -1, -1):
        steepest = _steepest(-work[point + 1], float(zero - point), most)
        work[point] = -max(min(-work[point], steepest), 0.0)


@kernel
def _steepest(work: float, ratio: float, most: float) -> float:
    """Return the largest next Y at which the slope of rho Y is at most ``most``; ``ratio`` is rho over the step."""
    return min((most + work * ratio) / (1.0 + ratio), most)


@kernel
def _zero(pattern: Pattern) -> int:
    """Return the point of the law where rho is zero."""
    return int(-pattern.rho_first / pattern.rho_step + 0.5)


@kernel
def evaluate(pattern: Pattern, s: float) -> tuple[float, float]:
    """Return phi and P at s; none for a wall that has moved the other way."""
    theta = _solve_theta(pattern, s, 0.0)
    if theta == 0.0:
        return 0.0, 0.0
    numbers = pattern.numbers
    linear, rho = numbers[LINEAR], numbers[RHO]
    work, area = read_law(pattern, theta * rho)
    phi = numbers[GAIN] * theta * work
    return phi, -(linear * numbers[GAIN] * area / (rho * rho) + 0.5 * phi * phi * numbers[DELIVERED])


@kernel
def stiffens(pattern: Pattern) -> bool:
    """Whether there is a pattern, of a wall that is pulled out: its potential is convex."""
    return bool(pattern.numbers[GAIN] != 0.0 and pattern.numbers[RHO] < 0.0)


@kernel
def evaluate_ahead(pattern: Pattern, s: float, moves: float) -> float:
    """Return phi at s + ``moves`` phi, ``moves`` >= 0, of a pattern that stiffens."""
    theta = _solve_theta(pattern, s, moves)
    return float(pattern.numbers[GAIN] * theta * read_law(pattern, theta * pattern.numbers[RHO])[0])


@kernel
def _solve_theta(pattern: Pattern, s: float, moves: float) -> float:
    """Return the theta at which the displacement is s + ``moves`` phi; 0 where the wall has moved the other way."""
    numbers = pattern.numbers
    linear, rho = numbers[LINEAR], numbers[RHO]
    if not s > 0.0 or numbers[GAIN] == 0.0:
        return 0.0
    low, high = 0.0, s / linear
    if rho < 0.0:
        high /= 1.0 - MOST_STIFFENING
    for _ in range(BISECTIONS):
        theta = 0.5 * (low + high)
        phi = numbers[GAIN] * theta * read_law(pattern, theta * rho)[0]
        if theta * linear + phi * (numbers[DELIVERED] - moves) < s:
            low = theta
        else:
            high = theta
    return float(0.5 * (low + high))
