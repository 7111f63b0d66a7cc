"""Books of what holds and the introducer's seal store: springs between a point of the jaws, or the lip, and the bodies.

A spring is told by its stretch, the distance of both points. The stretch at the start of a step is read off the bodies
there, that at its end off the solve, and a hold that is let go takes what it had stored with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.simulation.simulation import Simulation


@dataclass(frozen=True, slots=True)
class Grips:
    """What each hold stores at the end of a step, by the identity of its row, and what the seal does."""

    holds_j: dict[int, float]
    seal_j: float

    @property
    def total_j(self) -> float:
        """All that is stored."""
        return sum(self.holds_j.values()) + self.seal_j


def stored_in_grips(simulation: Simulation) -> Grips:
    """Return what holds and seal store at the end of the last step; a seal whose catheter sleeps has no row."""
    rows = simulation.system.rows
    holds_j = {int(rows.identity[row]): _end_energy_j(simulation, row) for row in simulation.holds.rows}
    return Grips(holds_j, simulation.seal.stored_j)


def enter_grips(simulation: Simulation, before: Grips) -> tuple[float, float]:
    """Return what the implicit step took out of the grips, and what was stored in those that are gone, in J.

    A hold that had found no row comes back with what it has been stretched by since: that is taken off again.
    """
    rows, stored = simulation.system.rows, stored_in_grips(simulation)
    taken_j, slipped_j, gone_j = 0.0, 0.0, 0.0
    for row in simulation.holds.rows:
        start_m = rows.frame[row] @ _hold_stretch_m(simulation, row)
        softness, force = rows.softness_m_n[row], rows.force_n[row]
        stretched_m = _linear_stretch_m(simulation, row) - start_m
        started_j = 0.5 * float(np.sum(start_m**2 / softness))
        taken_j -= float(force @ stretched_m) + stored.holds_j[int(rows.identity[row])] - started_j
        # What a hold has slid along is not straight, and its jaws turn: it does not begin a step as it ended the last.
        if int(rows.identity[row]) in before.holds_j:
            taken_j += before.holds_j[int(rows.identity[row])] - started_j
        else:
            gone_j -= started_j
        slipped_j += _slipped_j(simulation, row)
    for row in simulation.seal.rows:
        stretched_m = float(_linear_stretch_m(simulation, row)[0]) - simulation.seal.memory.start_m
        taken_j -= float(rows.force_n[row, 0]) * stretched_m + stored.seal_j - before.seal_j
        slipped_m = float(_linear_stretch_m(simulation, row)[0]) - simulation.seal.memory.elastic_m
        slipped_j -= float(rows.force_n[row, 0]) * slipped_m
    gone_j += sum(before.holds_j[hold] for hold in before.holds_j.keys() - stored.holds_j.keys())
    if not simulation.seal.rows:
        gone_j += before.seal_j - stored.seal_j
    return taken_j - slipped_j, gone_j


def _linear_stretch_m(simulation: Simulation, row: int) -> FloatArray:
    """Distance (3,) of both points at the end of the step in the row's frame, before what slides has slid."""
    rows, motion = simulation.system.rows, simulation.system.motion_m[3 * row : 3 * row + 3]
    stretch: FloatArray = motion - rows.softness_m_n[row] * rows.force_n[row]
    return stretch


def _end_energy_j(simulation: Simulation, row: int) -> float:
    """Energy of a hold's spring; where it slides, its point has come up to where the spring bears the limit.

    Of a motion that was taken back to a share, the spring has stretched by that share.
    """
    rows, share = simulation.system.rows, simulation.share
    softness = rows.softness_m_n[row]
    slides = simulation.system.slides[row]
    stretch = -softness * rows.force_n[row] if slides else _linear_stretch_m(simulation, row)
    if share < 1.0:
        start_m = rows.frame[row] @ _hold_stretch_m(simulation, row)
        stretch = start_m + share * (stretch - start_m)
    return 0.5 * float(np.sum(stretch**2 / softness))


def _slipped_j(simulation: Simulation, row: int) -> float:
    if not simulation.system.slides[row]:
        return 0.0
    motion = simulation.system.motion_m[3 * row : 3 * row + 3]
    return -float(simulation.system.rows.force_n[row] @ motion)


def _hold_stretch_m(simulation: Simulation, row: int) -> FloatArray:
    """Distance (3,) from what is held to its point in the jaws at the start of the step, along world axes."""
    rows, duct = simulation.system.rows, simulation.duct
    stretch: FloatArray = rows.point_m[row] + rows.rod_weight[row] @ simulation.catheter.start_m[rows.rod_node[row]]
    weights = rows.duct_weight[row]
    if weights.any():
        stretch -= weights @ duct.reduced.mesh.vertices_m[rows.duct_node[row]] + duct.displacement_m[row]
    return stretch
