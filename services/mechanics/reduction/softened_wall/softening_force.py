"""Modal force of the softening wall in a step, and its energy balance.

The contact forces define a load pattern, the modes' displacement along it its amplitude. While the pattern stays, the
force has a potential P. A new pattern is adopted only if the energy for it is there. Both rules are exact in discrete
time, so the wall never returns more energy than it was given, whatever the input:

- The force F(q1) at the start of a step is held over it: Newmark's step takes the mean of the forces at both ends, so
  that at its start is made F(q1) as well. It does the work F(q1) (q2 - q1), and for a concave potential that is never
  more than P(q1) - P(q2), whatever the step and the motion.
- When the pattern changes, P of the new pattern at the same displacement is compared with that of the old one. Surplus
  goes into the tank or is dissipated. A deficit comes from the tank; if it holds too little, the old pattern stays.
- The potential of a wall that is pulled outward is convex, and that of a law that turns has a convex part. There the
  force is taken at the end of the step, predicted with the contact forces of the last step (`push_ahead`): it too does
  no more work than the potential falls by. Where contacts change so that it does, as where the wall is let go, the step
  is corrected with the force at its actual end.

The softening can be faded, force and potential alike, which takes `FADE_S` for all of it. The potential then changes
without work, and the change is booked as dissipated.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.compiled.vectors import dot, row
from trocar.services.mechanics.reduction.softened_wall.load_pattern import (
    GAIN,
    PART,
    Pattern,
    copy_pattern,
    evaluate,
    evaluate_ahead,
    stiffens,
)
from trocar.services.mechanics.reduction.softened_wall.pattern_update import begin_candidate, continue_candidate
from trocar.services.mechanics.reduction.softened_wall.relaxation import follow_lag, lagging_j, lags
from trocar.services.mechanics.reduction.softened_wall.softened_wall import (
    N_MIXED,
    POTENTIAL,
    SPENT,
    STORED,
    TANK,
    SoftenedWall,
    softened_wall_at,
)
from trocar.services.mechanics.reduction.softening.softening_law import N_PARTS

FOLLOW_S = 2e-3
"""Time constant of the low-pass on the forces that define the pattern: it filters contacts that change every tick."""
LEAST_FORCE_N = 1e-7
"""Largest force on a site below which the wall counts as unloaded."""
TANK_SHARE = 0.1
"""Largest content of the tank over the potential; what exceeds it is dissipated."""
FADE_S = 0.25
"""Time in which all of the softening fades out or in. The change that a hand feels, newtons, then stays far below a
rig's limit on the rate of forces."""
CREDIT_J = 1e-9
"""Debt that the tank may have, the work of 1 mN over 1 um: patterns begin at a wall that has moved a little already."""


@kernel
def follow_loads(
    address: Address[SoftenedWall],
    loads: tuple[IntArray, FloatArray],
    modal_force: FloatArray,
    motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    gains: tuple[FloatArray, FloatArray, FloatArray],
    dt_s: float,
) -> None:
    """Balance the energy of the last step and write the modal force of the next one; see `push_ahead` as well.

    Args:
        loads: (nodes (l,), forces (l, 3)). Contact forces on the wall in the last step.
        modal_force: (r,) float64. What they are on the modes.
        motion: (q (r,), q_start (r,), qdot (r,), qddot (r,)). Modal coordinates at the end and at the start of the last
            step, and their rates and accelerations at its end. Changed are the accelerations, from which the next step
            takes the force that it begins with, and all but ``q_start`` where the force of the last step is corrected.
        gains: (position (r,), velocity (r,), acceleration (r,)). What a force that acts at the end of a step makes
            there, see `ModalGains`.
        dt_s: float. Length of the last step.
    """
    wall = softened_wall_at(address)
    q, _, _, qddot = motion
    is_pressed = _follow(wall, loads, modal_force, 1.0 - math.exp(-dt_s / FOLLOW_S))
    if not is_pressed and wall.pattern.numbers[GAIN] == 0.0 and not lags(wall):
        wall.faded[0] = wall.to_fade
        if wall.g.shape[0] > 0:
            follow_lag(wall, q, 0.0, dt_s)
        return
    _enter_step(wall, motion, gains)
    if wall.g.shape[0] > 0:
        _relax(wall, q, dt_s)
    if wall.faded[0] != wall.to_fade:
        _fade(wall, q, dt_s)
    if is_pressed and (wall.made[0] > 0 or begin_candidate(wall)) and continue_candidate(wall):
        _try_candidate(wall, q)
    if not is_pressed:
        _try_to_forget(wall, q)
    _keep_tank(wall)
    if not stiffens(wall.pattern):
        _push(wall, q, qddot)


@kernel
def _follow(wall: SoftenedWall, loads: tuple[IntArray, FloatArray], modal_force: FloatArray, part: float) -> bool:
    """Move the filtered forces a part of the way to those of the last step; False where none are left."""
    nodes, forces = loads
    largest = 0.0
    _keep_forces(wall, 1.0 - part)
    for load in range(nodes.shape[0]):
        node = nodes[load]
        for k in range(wall.near.shape[1]):
            total = 0.0
            for axis in range(3):
                total += wall.weights[node, k, axis] * forces[load, axis]
            for law in range(wall.at_sites.shape[0]):
                wall.at_sites[law, wall.near[node, k]] += part * total * wall.blunt[law, node]
        force = row(forces, load)
        if wall.at_nodes.shape[0] > 0:
            wall.at_nodes[node] += part * dot(row(wall.inward, node), force)
        _mix(wall, node, part * math.sqrt(dot(force, force)))
    acting = part if nodes.shape[0] > 0 else 0.0
    for mode in range(wall.modal.shape[0]):
        wall.modal[mode] += acting * modal_force[mode] - part * wall.modal[mode]
    for site in range(wall.at_sites.shape[1]):
        largest = max(largest, abs(wall.at_sites[0, site]))
    if nodes.shape[0] > 0 or largest >= LEAST_FORCE_N:
        return True
    _keep_forces(wall, 0.0)
    for mode in range(wall.modal.shape[0]):
        wall.modal[mode] = 0.0
    return False


@kernel
def _fade(wall: SoftenedWall, q: FloatArray, dt_s: float) -> None:
    """Fade the softening out or in. If none was left it restarts without a pattern, for the old one is out of date."""
    books, most = wall.books, dt_s / FADE_S
    if wall.faded[0] == 1.0:
        wall.pattern.numbers[GAIN] = 0.0
        wall.made[0] = 0
        wall.lag[:] = 0.0
        wall.lagged[:] = 0.0
        for term in range(wall.followed.shape[0]):
            for mode in range(q.shape[0]):
                wall.followed[term, mode] = q[mode]
    wall.faded[0] += min(max(wall.to_fade - wall.faded[0], -most), most)
    potential = _potential(wall, wall.pattern, q)
    books[SPENT] += books[POTENTIAL] - potential
    books[POTENTIAL] = potential


@kernel
def _keep_forces(wall: SoftenedWall, left: float) -> None:
    """Keep a part of the forces that were followed."""
    for law in range(wall.at_sites.shape[0]):
        for site in range(wall.at_sites.shape[1]):
            wall.at_sites[law, site] *= left
        for number in range(N_MIXED):
            wall.mixed[law, number] *= left
    for held in range(wall.at_nodes.shape[0]):
        wall.at_nodes[held] *= left


@kernel
def _mix(wall: SoftenedWall, node: int, force_n: float) -> None:
    """Count the laws' coefficients at a node, and the share of the second one, by the force on it."""
    for law in range(wall.mixed.shape[0]):
        for number in range(N_PARTS):
            wall.mixed[law, number] += force_n * wall.coefficients[law, node, number]
        wall.mixed[law, N_PARTS] += force_n * wall.counts[law, node]


@kernel
def _enter_step(
    wall: SoftenedWall,
    motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    gains: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Balance the last step: the fall of the potential less the work of the force goes into the tank."""
    books, numbers, q = wall.books, wall.pattern.numbers, motion[0]
    work, potential = _work(wall, motion), _potential(wall, wall.pattern, q)
    if stiffens(wall.pattern) and work + potential - books[POTENTIAL] > books[TANK] + CREDIT_J:
        _correct_step(wall, motion, gains)
        work, potential = _work(wall, motion), _potential(wall, wall.pattern, q)
    books[TANK] -= work + potential - books[POTENTIAL]
    if books[TANK] < -CREDIT_J:
        own = potential - (1.0 - wall.faded[0]) * lagging_j(wall, wall.pattern, q)
        if own > 0.0:
            numbers[PART] *= max(0.0, 1.0 + (books[TANK] + CREDIT_J) / own)
            left = _potential(wall, wall.pattern, q)
            books[TANK] += potential - left
            potential = left
    books[POTENTIAL] = potential


@kernel
def _relax(wall: SoftenedWall, q: FloatArray, dt_s: float) -> None:
    """Relax the force; the energy that takes is less than the linear wall dissipates in the same step."""
    books, pattern = wall.books, wall.pattern
    phi = pattern.numbers[PART] * evaluate(pattern, _along(wall, pattern, q))[0]
    follow_lag(wall, q, phi, dt_s)
    potential = _potential(wall, pattern, q)
    books[SPENT] -= potential - books[POTENTIAL]
    books[POTENTIAL] = potential


@kernel
def _work(wall: SoftenedWall, motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray]) -> float:
    """Return the work of the force in the last step."""
    work, q, q_start = 0.0, motion[0], motion[1]
    for mode in range(q.shape[0]):
        work += wall.force[mode] * (q[mode] - q_start[mode])
    return work


@kernel
def _correct_step(
    wall: SoftenedWall,
    motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    gains: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Replace the predicted force by the one at the actual end of the step.

    The prediction fails where a tool lets go of a wall that it pulled: the force assumed that the contact still holds.
    """
    q, _, qdot, qddot = motion
    times, old = 2.0 if wall.takes_mean else 1.0, wall.foretold
    for mode in range(q.shape[0]):
        old[mode] = wall.force[mode]
    _find_force(wall, motion[1], q, gains[0])
    for mode in range(q.shape[0]):
        change = wall.force[mode] - old[mode]
        q[mode] += times * gains[0][mode] * change
        qdot[mode] += times * gains[1][mode] * change
        qddot[mode] += (times * gains[2][mode] - (times - 1.0)) * change


@kernel
def _find_force(wall: SoftenedWall, start: FloatArray, end: FloatArray, position_gain: FloatArray) -> None:
    """Write the force of a step from ``start`` (r,) to where it leads; ``end`` (r,) is where ``force`` leads."""
    pattern, times, share = wall.pattern, 2.0 if wall.takes_mean else 1.0, 1.0 - wall.faded[0]
    s, moves = _along(wall, pattern, end), 0.0
    for mode in range(end.shape[0]):
        moved = times * position_gain[mode] * pattern.direction[mode]
        s -= moved * (wall.force[mode] - share * wall.lagged[mode])
        moves += moved * pattern.direction[mode]
    part = share * pattern.numbers[PART]
    phi = part * evaluate_ahead(pattern, _along(wall, pattern, start), s, moves * part)
    for mode in range(end.shape[0]):
        wall.force[mode] = phi * pattern.direction[mode] + share * wall.lagged[mode]


@kernel
def _potential(wall: SoftenedWall, pattern: Pattern, q: FloatArray) -> float:
    """Return the potential of a pattern and of its relaxation terms, less the faded part."""
    potential = evaluate(pattern, _along(wall, pattern, q))[1]
    return float((1.0 - wall.faded[0]) * (pattern.numbers[PART] * potential + lagging_j(wall, pattern, q)))


@kernel
def _potential_without(wall: SoftenedWall, pattern: Pattern, q: FloatArray) -> float:
    """Return the potential of the relaxation terms alone, as if the pattern did not act."""
    part = pattern.numbers[PART]
    pattern.numbers[PART] = 0.0
    potential = (1.0 - wall.faded[0]) * lagging_j(wall, pattern, q)
    pattern.numbers[PART] = part
    return float(potential)


@kernel
def _along(wall: SoftenedWall, pattern: Pattern, q: FloatArray) -> float:
    """Return s."""
    total = 0.0
    for mode in range(q.shape[0]):
        total += pattern.direction[mode] * (q[mode] - wall.rest_q[mode])
    return total


@kernel
def _try_candidate(wall: SoftenedWall, q: FloatArray) -> None:
    """Adopt the new pattern if there is energy for it, or of a stiffening one the part that there is energy for."""
    books, old, new = wall.books, wall.pattern, wall.candidate
    potential = _potential(wall, new, q)
    affordable = books[POTENTIAL] + books[TANK] + CREDIT_J
    if potential > affordable:
        without = _potential_without(wall, new, q)
        if affordable < without:
            return
        new.numbers[PART] = (affordable - without) / (potential - without)
        potential = _potential(wall, new, q)
    books[TANK] += books[POTENTIAL] - potential
    books[POTENTIAL] = potential
    copy_pattern(new, old)


@kernel
def _try_to_forget(wall: SoftenedWall, q: FloatArray) -> None:
    """Drop the pattern of an unloaded wall that has returned to rest; a debt of the tank remains."""
    books = wall.books
    wall.made[0] = 0
    left = _potential_without(wall, wall.pattern, q)
    if books[POTENTIAL] == left or books[POTENTIAL] - left + books[TANK] >= -2.0 * CREDIT_J:
        books[TANK] += books[POTENTIAL] - left
        books[POTENTIAL] = left
        wall.pattern.numbers[GAIN] = 0.0


@kernel
def _keep_tank(wall: SoftenedWall) -> None:
    """Dissipate the excess of the tank."""
    books = wall.books
    spent = max(0.0, books[TANK] - TANK_SHARE * abs(books[POTENTIAL]))
    books[TANK] -= spent
    books[SPENT] += spent
    books[STORED] = books[POTENTIAL] + books[TANK]


@kernel
def _push(wall: SoftenedWall, q: FloatArray, qddot: FloatArray) -> None:
    """Write the force of the next step and update the accelerations at its start."""
    phi, _ = evaluate(wall.pattern, _along(wall, wall.pattern, q))
    share = 1.0 - wall.faded[0]
    phi *= share * wall.pattern.numbers[PART]
    for mode in range(q.shape[0]):
        force = phi * wall.pattern.direction[mode] + share * wall.lagged[mode]
        if wall.takes_mean:
            qddot[mode] += force - wall.force[mode]
        wall.force[mode] = force


@kernel
def push_ahead(
    address: Address[SoftenedWall], q: FloatArray, end: FloatArray, position_gain: FloatArray, qddot: FloatArray
) -> None:
    """Write the force of the next step, of a pattern that stiffens: that of its end, where it stiffens.

    Args:
        q, end: (r,) float64. Modal coordinates at the start of the step, and at its end if the force stays that of the
            last one.
        position_gain: (r,) float64. What a force that acts at the end of the step moves them by there, see
            `ModalGains`.
        qddot: (r,) float64. Accelerations at the start of the step; changed, as the step takes from them the force that
            it begins with.
    """
    wall = softened_wall_at(address)
    for mode in range(qddot.shape[0]):
        qddot[mode] -= wall.force[mode] if wall.takes_mean else 0.0
    _find_force(wall, q, end, position_gain)
    for mode in range(qddot.shape[0]):
        qddot[mode] += wall.force[mode] if wall.takes_mean else 0.0
