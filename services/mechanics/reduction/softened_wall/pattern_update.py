"""Construction of the next load pattern from the forces on the sites, spread over several ticks."""

from __future__ import annotations

import math

from trocar.services.mechanics.compiled import kernel, summing_kernel
from trocar.services.mechanics.reduction.softened_wall.combined_law import mix_laws, share_laws, sum_energies
from trocar.services.mechanics.reduction.softened_wall.load_pattern import (
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
from trocar.services.mechanics.reduction.softened_wall.node_energies import LEAST_SHARE, add_node, begin_nodes
from trocar.services.mechanics.reduction.softened_wall.softened_wall import (
    FIRST,
    N_MIXED,
    N_NODES,
    N_SITES,
    NODE,
    SoftenedWall,
)

PAIRS = 512
"""Pairs of pressed sites that one tick processes: all pairs of 31 sites, 4 % of those of 160."""
PAIRS_A_NODE = 64
"""Cost of one node's remainder, in pairs of sites."""
LEAST_FIT = 1.0 / 3.0
"""m . t over V below which the modes reproduce the sites' displacement badly, so that the force is faded."""
MOST_ENERGY = 4.0
"""t . K t over V above which the same holds."""
NOTHING = 1e-9
"""Least |Y| and |rho| of a pattern that softens or stiffens."""


@kernel
def begin_candidate(wall: SoftenedWall) -> bool:
    """Take the forces of this tick for the next pattern; False where none are."""
    largest, count = 0.0, 0
    for law in range(wall.at_sites.shape[0]):
        for site in range(wall.at_sites.shape[1]):
            largest = max(largest, abs(wall.at_sites[law, site]))
    for site in range(wall.at_sites.shape[1]):
        counts = _take_site(wall, site, LEAST_SHARE * largest)
        if counts:
            wall.active[count] = site
            count += 1
    for mode in range(wall.modal.shape[0]):
        wall.pressed_modal[mode] = wall.modal[mode]
    for law in range(wall.mixed.shape[0]):
        for number in range(N_MIXED):
            wall.pressed_mixed[law, number] = wall.mixed[law, number]
    wall.made[N_SITES], wall.made[FIRST] = count, 0
    share_laws(wall)
    wall.made[N_NODES] = 0
    if wall.shares[0] < 1.0:
        begin_nodes(wall)
    return count > 0


@kernel
def _take_site(wall: SoftenedWall, site: int, least: float) -> bool:
    """Take the forces on a site, unless they are less than ``least``; whether they are not."""
    counts = False
    for law in range(wall.at_sites.shape[0]):
        counts = counts or abs(wall.at_sites[law, site]) > least
    for law in range(wall.at_sites.shape[0]):
        wall.pressed[law, site] = wall.at_sites[law, site] if counts else 0.0
        wall.quadratic[law, site] = 0.0
        wall.moved[law, site] = 0.0
    return counts


@kernel
def continue_candidate(wall: SoftenedWall) -> bool:
    """Take on some more pairs of sites, and nodes; True when the pattern is complete."""
    made, left = wall.made, PAIRS
    while left > 0 and made[FIRST] < made[N_SITES]:
        for law in range(wall.shares.shape[0]):
            if wall.shares[law] > 0.0:
                _add_linear(wall, law, wall.active[made[FIRST]])
                _add_pairs(wall, law, made[FIRST])
                left -= made[FIRST] + 1
        made[FIRST] += 1
    while left > 0 and made[NODE] < made[N_NODES]:
        add_node(wall, wall.active_nodes[made[NODE]])
        made[NODE] += 1
        left -= PAIRS_A_NODE
    if made[FIRST] < made[N_SITES] or made[NODE] < made[N_NODES]:
        return False
    made[N_SITES] = 0
    _complete(wall)
    return True


@kernel
def _add_linear(wall: SoftenedWall, law: int, site: int) -> None:
    """Add a site to W a."""
    force = wall.pressed[law, site]
    for other in range(wall.moved.shape[1]):
        wall.moved[law, other] += force * wall.local[site, other]


@kernel
def _add_pairs(wall: SoftenedWall, law: int, last: int) -> None:
    """Add the pairs of an active site with itself and with those before it to T a a / 2."""
    out, pressed, site = wall.quadratic[law], wall.pressed[law], wall.active[last]
    for place in range(last + 1):
        other = wall.active[place]
        product, row = pressed[site] * pressed[other] * (0.5 if place == last else 1.0), wall.third[site, other]
        for k in range(out.shape[0]):
            out[k] += product * row[k]


@kernel
def _complete(wall: SoftenedWall) -> None:
    """Write the numbers, the law and the direction of the pattern."""
    made = wall.candidate
    V, E = sum_energies(wall)
    rho = -E / V if V > 0.0 else 0.0
    numbers = made.numbers
    numbers[GAIN], numbers[RHO], numbers[PART], numbers[TURN] = 0.0, rho, 1.0, math.inf
    if abs(rho) < NOTHING:
        return
    mix_laws(wall, V, rho)
    integrate_law(made)
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
    bound_law(made)
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
            wall.shift[site] = 0.5 * wall.moved[0, site]
        return True, 0.5
    work, area = read_law(made, rho)
    if abs(work) < NOTHING * abs(rho):
        return False, 0.0
    energy = area / (rho * rho)  # Phi
    slope = work - 2.0 * energy  # rho times the derivative of Phi
    for site in range(wall.shift.shape[0]):
        wall.shift[site] = ((energy - slope) * wall.moved[0, site] - slope / rho * wall.quadratic[0, site]) / work
    return True, (energy - slope) / work


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
