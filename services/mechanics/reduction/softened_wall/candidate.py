"""Patterns from the forces on the sites: the cubic energy's derivatives, over as many ticks as they take."""

from __future__ import annotations

import math

from services.mechanics.compiled import kernel, summing_kernel
from services.mechanics.reduction.softened_wall.pattern import (
    DELIVERED,
    GAIN,
    LINEAR,
    PART,
    RHO,
    TURN,
    bound_law,
    integrate_law,
    read_law,
    turns,
)
from services.mechanics.reduction.softened_wall.wall import N_MIXED, SoftenedWall
from services.mechanics.reduction.softening.law import N_PARTS

LEAST_SHARE = 1e-4
"""Of the largest force on a site: below it a site does not count."""
PAIRS = 512
"""Pairs of pressed sites that a tick takes on: all of 31 sites, 4 % of those of 160."""
LEAST_FIT = 1.0 / 3.0
"""m . t over V: below it the modes hardly give the sites' displacement, and the force fades."""
MOST_ENERGY = 4.0
"""t . K t over V: likewise above it."""
NOTHING = 1e-9
"""Least |Y| and |rho| of a pattern that softens or stiffens."""


@kernel
def begin_candidate(wall: SoftenedWall) -> bool:
    """Take the forces of this tick for the next pattern; False where none are."""
    largest, count = 0.0, 0
    for site in range(wall.at_sites.shape[0]):
        largest = max(largest, abs(wall.at_sites[site]))
    for site in range(wall.at_sites.shape[0]):
        counts = abs(wall.at_sites[site]) > LEAST_SHARE * largest
        wall.pressed[site] = wall.at_sites[site] if counts else 0.0
        wall.quadratic[site] = 0.0
        wall.moved[site] = 0.0
        if counts:
            wall.active[count] = site
            count += 1
    for mode in range(wall.modal.shape[0]):
        wall.pressed_modal[mode] = wall.modal[mode]
    for number in range(N_MIXED):
        wall.pressed_mixed[number] = wall.mixed[number]
    wall.made[0], wall.made[1], wall.made[2] = count, 0, 0
    return count > 0


@kernel
def continue_candidate(wall: SoftenedWall) -> bool:
    """Take on some more pairs of sites; True when the pattern is complete."""
    n, first, second = wall.made[0], wall.made[1], wall.made[2]
    for _ in range(PAIRS):
        if second == 0:
            _add_linear(wall, wall.active[first])
        _add_pair(wall, wall.active[first], wall.active[second])
        second += 1
        if second > first:
            first, second = first + 1, 0
        if first == n:
            wall.made[0] = 0
            _complete(wall)
            return True
    wall.made[1], wall.made[2] = first, second
    return False


@kernel
def _add_linear(wall: SoftenedWall, site: int) -> None:
    """Add a site to W a."""
    force = wall.pressed[site]
    for other in range(wall.moved.shape[0]):
        wall.moved[other] += force * wall.local[site, other]


@kernel
def _add_pair(wall: SoftenedWall, first: int, second: int) -> None:
    """Add a pair of sites to T a a / 2."""
    product = wall.pressed[first] * wall.pressed[second] * (0.5 if first == second else 1.0)
    for site in range(wall.quadratic.shape[0]):
        wall.quadratic[site] += product * wall.third[first, second, site]


@kernel
def _complete(wall: SoftenedWall) -> None:
    """Write the numbers, the law and the direction of the pattern."""
    made, a = wall.candidate, wall.pressed
    V, E = 0.0, 0.0
    for site in range(a.shape[0]):
        V += 0.5 * a[site] * wall.moved[site]
        E += a[site] * wall.quadratic[site] / 3.0
    rho = -E / V if V > 0.0 else 0.0
    numbers = made.numbers
    numbers[GAIN], numbers[RHO], numbers[PART], numbers[TURN] = 0.0, rho, 1.0, math.inf
    _mix_law(wall)
    if abs(rho) < NOTHING:
        return
    is_there, part = _shift(wall, rho)
    if not is_there:
        return
    linear, delivered = _deliver(wall, part)
    fit = linear / V
    if not fit > 0.0:
        return
    gain = 1.0 / fit if fit > LEAST_FIT else fit**2 / LEAST_FIT**3
    numbers[LINEAR], numbers[DELIVERED] = linear, delivered
    numbers[GAIN] = gain * min(1.0, MOST_ENERGY * V / delivered)
    bound_law(made, wall.most_softening)
    integrate_law(made)


@kernel
def _shift(wall: SoftenedWall, rho: float) -> tuple[bool, float]:
    """Write inward displacements of the sites that do the work V: those of the forces, by the law.

    (Phi - rho Phi') W a - Phi' T a a / 2, over Y; False if there are none, and the first factor. Where the law turns Y
    goes through zero: there the linear ones stand for all, W a / 2, as they do where the wall is pulled out. Of all
    shapes the wall can be stiffened most along these, and they are the same for any size of the forces: as those of
    second order are not, a wall that was pulled further would have needed energy for the next pattern.
    """
    made = wall.candidate
    if turns(made) or rho < 0.0:
        for site in range(wall.shift.shape[0]):
            wall.shift[site] = 0.5 * wall.moved[site]
        return True, 0.5
    work, area = read_law(made, rho)
    if abs(work) < NOTHING * abs(rho):
        return False, 0.0
    energy = area / (rho * rho)  # Phi
    slope = work - 2.0 * energy  # rho times the derivative of Phi
    for site in range(wall.shift.shape[0]):
        wall.shift[site] = ((energy - slope) * wall.moved[site] - slope / rho * wall.quadratic[site]) / work
    return True, (energy - slope) / work


@kernel
def _mix_law(wall: SoftenedWall) -> None:
    """Write the law of forces on these nodes."""
    made, mixed = wall.candidate, wall.pressed_mixed
    made.work[:] = 0.0
    for part in range(N_PARTS):
        coefficient = mixed[part] / mixed[N_PARTS]
        for point in range(made.work.shape[0]):
            made.work[point] += coefficient * wall.parts[part, point]
    integrate_law(made)


@summing_kernel
def _deliver(wall: SoftenedWall, part: float) -> tuple[float, float]:
    """Write n = K t for the modal coordinates t that move the sites by ``shift``; return m . t and t . K t.

    Those beside supports, which sites are too far apart for, move as far as ``part`` of the linear response does.
    """
    linear, delivered = 0.0, 0.0
    first_local = wall.stiffness.shape[0] - wall.n_local
    for mode in range(wall.stiffness.shape[0]):
        total = 0.0
        if mode < first_local:
            for site in range(wall.shift.shape[0]):
                total += wall.delivery[mode, site] * wall.shift[site]
        else:
            total = part * wall.pressed_modal[mode] / wall.stiffness[mode]
        wall.candidate.direction[mode] = wall.stiffness[mode] * total
        linear += total * wall.pressed_modal[mode]
        delivered += wall.stiffness[mode] * total * total
    return linear, delivered
