"""What a wall does by itself at the end of a step, in one kernel: it relaxes, and softens as it is pressed then.

Contact forces are told along the wall's own axes for it, which large rotations turn. Loads that lag are written over
them, so the pattern of the softening comes first.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.duct_loads import DuctLoads, loads_at
from trocar.services.mechanics.bodies.turned_points import follow_axis
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.compiled.vectors import copy_rows
from trocar.services.mechanics.reduction.large_rotations.warping_kernels import WarpedTube, turn_vectors
from trocar.services.mechanics.reduction.softened_wall.pattern_change import change_pattern
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SoftenedWall
from trocar.services.mechanics.reduction.viscoelastic import relax_coordinates
from trocar.services.mechanics.reduction.viscous_loads import LaggingLoads, lagging_at, relax_loads
from trocar.services.mechanics.reduction.wall_step.implicit_step import WallStep, relax_wall, wall_at

NOBODY = 0
"""Address of what a wall does not have."""
EndingWall = tuple[
    Address[DuctLoads],
    tuple[Address[WarpedTube], Address[WarpedTube]],
    Address[WallStep],
    Address[SoftenedWall],
    Address[LaggingLoads],
]
"""Loads, the sections at the start of a step and at its end, the terms, their softening, and the loads that lag."""
LaggingModes = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Stiffness (r,), shares (t,), decay over the step (t,), and the coordinates that lag (t, r): of `ViscousModes`."""


@kernel
def end_wall_step(
    addresses: EndingWall, modes: LaggingModes, own: FloatArray, acts: bool, dt_s: float
) -> tuple[float, float]:
    """End a step of ``dt_s``; return the energy (J) that the terms have lost by it, and the linear modes.

    ``own`` (l, 3) is scratch for forces along the wall's axes. ``acts`` says whether a term has pushed in this step.
    """
    loads, wall = loads_at(addresses[0]), wall_at(addresses[2])
    duct, (stiffness, g, decay, d), n, lost_j = loads.free, modes, loads.count[1], 0.0
    _turn_loads(addresses[1], loads, n, own)
    relaxed_j = relax_coordinates(stiffness, g, decay, duct.q, d)
    if g.shape[0] > 0 and (acts or _lags(wall)):
        relax_wall(addresses[2], duct.start, duct.q, decay)
    if int(addresses[3]) != NOBODY and wall.pattern.faded[0] != 1.0:
        pressed = loads.node[:n], own[:n]
        lost_j = change_pattern(addresses[3], addresses[2], pressed, loads.impulse, (duct.q, d), dt_s)
    if int(addresses[4]) != NOBODY:
        loads.count[0] = relax_loads(addresses[4], loads.node, own, n)
        _turn_back(addresses[1][0], loads, lagging_at(addresses[4]), own)
    return lost_j, relaxed_j


@kernel
def _turn_loads(
    sections: tuple[Address[WarpedTube], Address[WarpedTube]], loads: DuctLoads, n: int, own: FloatArray
) -> None:
    """Write the first n loads along the wall's axes where the step has ended."""
    if int(sections[0]) == NOBODY:
        copy_rows(loads.force, own, n)
    else:
        follow_axis(sections[0], sections[1], loads.free.q)
        turn_vectors(sections[0], loads.node[:n], True, loads.force[:n], own[:n])


@kernel
def _turn_back(sections: Address[WarpedTube], loads: DuctLoads, lagging: LaggingLoads, own: FloatArray) -> None:
    """Write all loads, which are ``own`` along the wall's axes, along those of the world; turn what lasts of them."""
    n, n_lag = loads.count[0], lagging.count[0]
    copy_rows(own, loads.force, n)
    if int(sections) != NOBODY:
        turn_vectors(sections, loads.node[:n], False, own[:n], loads.force[:n])
        turn_vectors(sections, lagging.node[:n_lag], False, lagging.lasting[:n_lag], lagging.lasting[:n_lag])


@kernel
def _lags(wall: WallStep) -> bool:
    for term in range(wall.lag.shape[0]):
        for mode in range(wall.lag.shape[1]):
            if wall.lag[term, mode] != 0.0:
                return True
    return False
