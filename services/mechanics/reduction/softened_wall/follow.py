"""The wall's softening in a step: which modal force the loads on the wall call for, and its books.

Forces on the wall say *what* is pressed, a pattern; the modes' displacement along it says *how far*. The force has a
potential P as long as the pattern stays, and a change of pattern is taken on when it costs nothing that is not there.
Both are exact in time, so that nothing that was not put in comes out, whatever the input:

- The force F(q1) at the start of a step is held over it: Newmark's step takes the mean of the forces at both ends, so
  that at its start is made F(q1) as well. It does the work F(q1) (q2 - q1), and for a concave potential that is never
  more than P(q1) - P(q2), whatever the step and the motion.
- When the pattern changes, P of the new one at the same displacement is compared with that of the old one. What is less
  is spent, or kept in the tank; what is more is taken from the tank, or the old pattern stays.
- The potential of a wall that is pulled out is convex, and the step gives out a little more than it falls by. That
  comes from the tank, or from the potential itself, of which less acts from then on.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.reduction.softened_wall.candidate import begin_candidate, continue_candidate
from services.mechanics.reduction.softened_wall.pattern import GAIN, PART, Pattern, copy_pattern, evaluate
from services.mechanics.reduction.softened_wall.wall import (
    POTENTIAL,
    SPENT,
    STORED,
    TANK,
    SoftenedWall,
    softened_wall_at,
)

FOLLOW_S = 2e-3
"""Time in which the pattern of forces is followed: noise of contacts that change from tick to tick stays out."""
LEAST_FORCE_N = 1e-7
"""Below it a wall is not pressed."""
TANK_SHARE = 0.1
"""Of the potential: more than that the tank does not keep."""
CREDIT_J = 1e-9
"""The tank may owe so much: patterns begin at a wall that has moved a little already."""


@kernel
def follow_loads(
    address: Address[SoftenedWall],
    loads: tuple[IntArray, FloatArray],
    modal_force: FloatArray,
    motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    dt_s: float,
) -> None:
    """Write the modal force of the next step, and enter what that of the last one has done.

    Parameters
    ----------
    address : Address[SoftenedWall]
    loads : (nodes (l,), forces (l, 3))
        Contact forces on the wall in the last step.
    modal_force : (r,) float64
        What they are on the modes.
    motion : (q (r,), q_start (r,), qdot (r,), qddot (r,))
        Modal coordinates at the end and at the start of the last step, and their rates and accelerations at its end.
        The latter are changed: the next step takes from them the force that it begins with.
    dt_s : float
        Length of the last step.
    """
    wall = softened_wall_at(address)
    q, q_start, qdot, qddot = motion
    is_pressed = _follow(wall, loads, modal_force, 1.0 - math.exp(-dt_s / FOLLOW_S))
    if not is_pressed and wall.pattern.numbers[GAIN] == 0.0:
        return
    _enter_step(wall, q, q_start)
    if is_pressed and (wall.made[0] > 0 or begin_candidate(wall)) and continue_candidate(wall):
        _try_candidate(wall, q)
    if not is_pressed:
        _try_to_forget(wall)
    _keep_tank(wall)
    _push(wall, q, (qdot, qddot), dt_s)


@kernel
def _follow(wall: SoftenedWall, loads: tuple[IntArray, FloatArray], modal_force: FloatArray, part: float) -> bool:
    """Go a part of the way to the forces on the sites and on the modes; False where none are left."""
    nodes, forces = loads
    largest = 0.0
    for site in range(wall.at_sites.shape[0]):
        wall.at_sites[site] *= 1.0 - part
    for load in range(nodes.shape[0]):
        node = nodes[load]
        for k in range(wall.near.shape[1]):
            total = 0.0
            for axis in range(3):
                total += wall.weights[node, k, axis] * forces[load, axis]
            wall.at_sites[wall.near[node, k]] += part * total
    acting = part if nodes.shape[0] > 0 else 0.0
    for mode in range(wall.modal.shape[0]):
        wall.modal[mode] += acting * modal_force[mode] - part * wall.modal[mode]
    for site in range(wall.at_sites.shape[0]):
        largest = max(largest, abs(wall.at_sites[site]))
    if nodes.shape[0] > 0 or largest >= LEAST_FORCE_N:
        return True
    for site in range(wall.at_sites.shape[0]):
        wall.at_sites[site] = 0.0
    for mode in range(wall.modal.shape[0]):
        wall.modal[mode] = 0.0
    return False


@kernel
def _enter_step(wall: SoftenedWall, q: FloatArray, q_start: FloatArray) -> None:
    """Enter the work of the last step: what it was less than the potential has fallen goes into the tank."""
    work = 0.0
    for mode in range(q.shape[0]):
        work += wall.force[mode] * (q[mode] - q_start[mode])
    books, numbers = wall.books, wall.pattern.numbers
    potential = _potential(wall, wall.pattern, q)
    books[TANK] -= work + potential - books[POTENTIAL]
    if books[TANK] < -CREDIT_J and potential > 0.0:
        kept = max(0.0, 1.0 + (books[TANK] + CREDIT_J) / potential)
        numbers[PART] *= kept
        books[TANK] += (1.0 - kept) * potential
        potential *= kept
    books[POTENTIAL] = potential


@kernel
def _potential(wall: SoftenedWall, pattern: Pattern, q: FloatArray) -> float:
    """Return P of a pattern, as much of it as acts."""
    potential = evaluate(pattern, _along(wall, pattern, q))[1]
    return float(pattern.numbers[PART] * potential)


@kernel
def _along(wall: SoftenedWall, pattern: Pattern, q: FloatArray) -> float:
    """Return s."""
    total = 0.0
    for mode in range(q.shape[0]):
        total += pattern.direction[mode] * (q[mode] - wall.rest_q[mode])
    return total


@kernel
def _try_candidate(wall: SoftenedWall, q: FloatArray) -> None:
    """Take the candidate on, of one that stiffens as much as there is energy for, unless it would cost too much."""
    books, old, new = wall.books, wall.pattern, wall.candidate
    potential = _potential(wall, new, q)
    affordable = books[POTENTIAL] + books[TANK] + CREDIT_J
    if potential > affordable:
        if affordable < 0.0:
            return
        new.numbers[PART] = affordable / potential
        potential = affordable
    books[TANK] += books[POTENTIAL] - potential
    books[POTENTIAL] = potential
    copy_pattern(new, old)


@kernel
def _try_to_forget(wall: SoftenedWall) -> None:
    """Drop the pattern of a wall that nothing presses and that has come back; what the tank owes, it goes on owing."""
    books = wall.books
    wall.made[0] = 0
    if books[POTENTIAL] == 0.0 or books[POTENTIAL] + books[TANK] >= -2.0 * CREDIT_J:
        books[TANK] += books[POTENTIAL]
        books[POTENTIAL] = 0.0
        wall.pattern.numbers[GAIN] = 0.0


@kernel
def _keep_tank(wall: SoftenedWall) -> None:
    """Spend what is more than the tank keeps."""
    books = wall.books
    spent = max(0.0, books[TANK] - TANK_SHARE * abs(books[POTENTIAL]))
    books[TANK] -= spent
    books[SPENT] += spent
    books[STORED] = books[POTENTIAL] + books[TANK]


@kernel
def _push(wall: SoftenedWall, q: FloatArray, rates: tuple[FloatArray, FloatArray], dt: float) -> None:
    """Write the force of the next step, and let the accelerations start with it."""
    qdot, qddot = rates
    pattern = wall.pattern
    phi, potential = evaluate(pattern, _along(wall, pattern, q))
    if phi < 0.0:
        back = 0.0
        for mode in range(q.shape[0]):
            back -= pattern.direction[mode] * qdot[mode] * dt
        # A wall that comes back this far in a step would be given more than the potential has.
        if -phi * back > potential:
            phi = -potential / back
    phi *= pattern.numbers[PART]
    for mode in range(q.shape[0]):
        force = phi * pattern.direction[mode]
        if wall.takes_mean:
            qddot[mode] += force - wall.force[mode]
        wall.force[mode] = force
