"""Which pattern of loads acts on a softening wall: that of its contact forces, as long as there is energy for it.

Between two steps the pattern is made anew from the forces of the last ticks. It is adopted only if the wall's energy at
the same displacement does not rise by more than the tank of the wall's step holds, see `energy_tank`; else the old one
stays. So a change of pattern never gives out energy that was not put in.
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
    conjugate,
    copy_pattern,
    pattern_energy,
)
from trocar.services.mechanics.reduction.softened_wall.pattern_update import begin_candidate, continue_candidate
from trocar.services.mechanics.reduction.softened_wall.softened_wall import N_MIXED, SoftenedWall, softened_wall_at
from trocar.services.mechanics.reduction.softening.softening_law import N_PARTS
from trocar.services.mechanics.reduction.wall_step.implicit_step import (
    CREDIT_J,
    ENERGY,
    TANK,
    WallStep,
    following_share,
    place_pattern,
    read_pattern,
    wall_at,
)
from trocar.services.mechanics.reduction.wall_step.polynomial_membrane import polynomial_energy

FOLLOW_S = 2e-3
"""Time constant of the low-pass on the forces that define the pattern: it filters contacts that change every tick."""
LEAST_FORCE_N = 1e-7
"""Largest force on a site below which the wall counts as unloaded."""


@kernel
def change_pattern(
    address: Address[SoftenedWall],
    wall_address: Address[WallStep],
    loads: tuple[IntArray, FloatArray],
    modal_force: FloatArray,
    lagging: tuple[FloatArray, FloatArray],
    dt_s: float,
) -> float:
    """Follow the contact forces of a step, at its end, and return by how much the energy of the terms falls thereby.

    What lags changes as well, and has no part in that: its energy is known from its state at any time.

    Args:
        loads: (nodes (l,), forces (l, 3)). Contact forces on the wall.
        modal_force: (r,) float64. What they are on the modes.
        lagging: (q (r,), d (t, r)). Modal coordinates, and those that lag behind them.
        dt_s: float. Length of the step.
    """
    soft, wall = softened_wall_at(address), wall_at(wall_address)
    is_pressed = _follow(soft, loads, modal_force, 1.0 - math.exp(-dt_s / FOLLOW_S))
    if not is_pressed:
        soft.made[0] = 0
        return _try_to_forget(wall, lagging) if wall.pattern.numbers[GAIN] != 0.0 else 0.0
    if (soft.made[0] > 0 or begin_candidate(soft)) and continue_candidate(soft):
        return _try_candidate(wall, soft.candidate, lagging)
    return 0.0


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
def _try_candidate(wall: WallStep, new: Pattern, lagging: tuple[FloatArray, FloatArray]) -> float:
    """Adopt the new pattern if there is energy for it, or of a stiffening one the part that there is energy for."""
    old = wall.pattern
    new.faded[0] = old.faded[0]
    before, lagged = _own_energy(wall, old, lagging)
    affordable = before + lagged + wall.books[TANK] + CREDIT_J
    after, lags = _own_energy(wall, new, lagging)
    if after + lags > affordable:
        most, new.numbers[PART] = after + lags, 0.0
        after, lags = _own_energy(wall, new, lagging)
        without = after + lags
        if affordable < without:
            return 0.0
        new.numbers[PART] = (affordable - without) / (most - without)
        after, lags = _own_energy(wall, new, lagging)
    copy_pattern(new, old)
    _adopt(wall, lagging[0], before + lagged - after - lags)
    return before - after


@kernel
def _try_to_forget(wall: WallStep, lagging: tuple[FloatArray, FloatArray]) -> float:
    """Drop the pattern of an unloaded wall that has returned to rest."""
    pattern, gain = wall.pattern, wall.pattern.numbers[GAIN]
    before, lagged = _own_energy(wall, pattern, lagging)
    pattern.numbers[GAIN] = 0.0
    after, lags = _own_energy(wall, pattern, lagging)
    if after + lags > before + lagged + max(wall.books[TANK], 0.0) + 2.0 * CREDIT_J:
        pattern.numbers[GAIN] = gain
        return 0.0
    _adopt(wall, lagging[0], before + lagged - after - lags)
    return before - after


@kernel
def _adopt(wall: WallStep, q: FloatArray, fell: float) -> None:
    """Go on with the pattern that is there now."""
    place_pattern(wall)
    wall.books[ENERGY] = read_pattern(wall, q)
    wall.books[TANK] += fell


@kernel
def _own_energy(wall: WallStep, pattern: Pattern, lagging: tuple[FloatArray, FloatArray]) -> tuple[float, float]:
    """Return the energy that hangs on the pattern, its own and the polynomial's, and that of what lags of its own."""
    q, d = lagging
    gain, polynomial = pattern.numbers[GAIN], wall.polynomial
    s = _along(wall, pattern, q, 0.0, q) if gain != 0.0 else 0.0
    first = 3 * wall.membrane.energy.shape[0]
    x = wall.place[first : first + polynomial.coordinates.shape[0]]
    for i in range(x.shape[0]):
        own = polynomial.coordinates[i]
        x[i] = q[own] - following_share(wall, pattern, own) * s
    lags = 0.0
    for term in range(wall.g.shape[0]):
        if gain != 0.0:
            behind = _along(wall, pattern, d[term], 1.0, wall.lag[term])
            lags += (1.0 - pattern.faded[0]) * wall.g[term] * conjugate(pattern, behind)
    return pattern_energy(pattern, s) + polynomial_energy(polynomial, x), lags


@kernel
def _along(wall: WallStep, pattern: Pattern, q: FloatArray, lags: float, lag: FloatArray) -> float:
    """Return s of modal coordinates (r,), and of those that ``lags`` times ``lag`` (r,) moves the linear wall by."""
    total = 0.0
    for mode in range(q.shape[0]):
        moved = q[mode] - wall.rest[mode] + lags * lag[mode] / wall.stiffness[mode]
        total += pattern.direction[mode] * moved
    return total
