"""Law of a pattern, combined of the law of the sites and that of the nodes, each with energies of its own.

With V_i, E_i the energies that either has and s_i its share, V = sum_i s_i V_i and E = sum_i s_i E_i, and the forces do
the work V Y(theta rho) = sum_i s_i V_i Y_i(theta rho_i): a law like any other, whose first term is 3 rho.
"""

from __future__ import annotations

from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.reduction.softened_wall.node_energies import LINEAR_J, MORE_J
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SoftenedWall
from trocar.services.mechanics.reduction.softening.softening_law import N_PARTS

MOST_OF_SITES = 3.0
"""Largest factor by which the nodes' cubic energy may scale the displacement that the sites give."""
NOTHING_OF = 1e-6
"""Share of a law below which it counts as zero."""


@kernel
def share_laws(wall: SoftenedWall) -> None:
    """Write the shares that the laws have of the forces on these nodes."""
    shares, mixed = wall.shares, wall.pressed_mixed
    shares[0] = 1.0
    if shares.shape[0] == 1:
        return
    share = mixed[1, N_PARTS] / mixed[0, N_PARTS] if mixed[0, N_PARTS] > 0.0 else 0.0
    if share < NOTHING_OF:
        share = 0.0
    if share > 1.0 - NOTHING_OF:
        share = 1.0
    shares[0], shares[1] = 1.0 - share, share


@kernel
def sum_energies(wall: SoftenedWall) -> tuple[float, float]:
    """Return V and E; what sites move by is that of both laws from here on, in the first row."""
    V, E, shares = 0.0, 0.0, wall.shares
    for law in range(shares.shape[0]):
        if shares[law] > 0.0:
            _write_energies(wall, law)
            V += shares[law] * wall.energies[law, 0]
            E += shares[law] * wall.energies[law, 1]
    if shares[0] < 1.0:
        for site in range(wall.moved.shape[1]):
            wall.moved[0, site] = shares[0] * wall.moved[0, site] + shares[1] * wall.moved[1, site]
            wall.quadratic[0, site] = shares[0] * wall.quadratic[0, site] + shares[1] * wall.quadratic[1, site]
    return V, E


@kernel
def _write_energies(wall: SoftenedWall, law: int) -> None:
    """Write V and E of one law; what sites move by is scaled to those of the nodes."""
    V, E = 0.0, 0.0
    for site in range(wall.pressed.shape[1]):
        V += 0.5 * wall.pressed[law, site] * wall.moved[law, site]
        E += wall.pressed[law, site] * wall.quadratic[law, site] / 3.0
    if law == 1:
        whole, more = wall.of_nodes[LINEAR_J], wall.of_nodes[MORE_J]
        linear = whole / V if V > 0.0 else 1.0
        cubic = min(max(1.0 + more / E, 0.0), MOST_OF_SITES) if E != 0.0 else 1.0
        for site in range(wall.pressed.shape[1]):
            wall.moved[law, site] *= linear
            wall.quadratic[law, site] *= cubic
        V, E = whole, E + more
    wall.energies[law, 0], wall.energies[law, 1] = V, E


@kernel
def mix_laws(wall: SoftenedWall, V: float, rho: float) -> None:
    """Write Y of the pattern, whose energies are V and -rho V; V is above nothing."""
    work = wall.candidate.work
    work[:] = 0.0
    for law in range(wall.shares.shape[0]):
        own_V = wall.energies[law, 0]
        if wall.shares[law] > 0.0 and own_V > 0.0:
            _mix_law(wall, law)
            ratio = -wall.energies[law, 1] / own_V / rho if rho != 0.0 else 1.0
            _add_law(wall, wall.shares[law] * own_V / V, ratio)


@kernel
def _mix_law(wall: SoftenedWall, law: int) -> None:
    """Write one law of forces on these nodes."""
    mixed = wall.pressed_mixed
    wall.law[:] = 0.0
    for part in range(N_PARTS):
        coefficient = mixed[law, part] / mixed[0, N_PARTS]
        for point in range(wall.law.shape[0]):
            wall.law[point] += coefficient * wall.parts[law, part, point]


@kernel
def _add_law(wall: SoftenedWall, share: float, ratio: float) -> None:
    """Add a law whose own rho is ``ratio`` times that of the pattern; straight between points, constant beyond."""
    made, law = wall.candidate, wall.law
    last = law.shape[0] - 1
    for point in range(law.shape[0]):
        if ratio == 1.0:
            made.work[point] += share * law[point]
            continue
        place = (ratio * (made.rho_first + point * made.rho_step) - made.rho_first) / made.rho_step
        inside = min(max(place, 0.0), float(last))
        before = min(int(inside), last - 1)
        made.work[point] += share * (law[before] + (inside - before) * (law[before + 1] - law[before]))
