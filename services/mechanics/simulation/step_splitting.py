"""Splits steps into substeps, so that no body moves further in one than contact detection looks ahead."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, FloatArray
from trocar.services.mechanics.bodies.forceps.sweep import FASTEST_HAND_M_S
from trocar.services.mechanics.collision.candidate_list import LOOK_AHEAD_M
from trocar.services.mechanics.compiled import kernel, summing_kernel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.world import World

# Motion of the catheter in a step that is always allowed: strands thicker than 1 mm that approach each other by it
# cannot change sides.
SLOW_M = 0.5e-3
# Number of wall nodes whose speed is sampled; they suffice because fast modes have long wavelengths.
N_NODES = 32
# Longest step, unless the quality level allows more: contacts act as impulses at its start, which make the wall
# oscillate by half of its deflection.
LONGEST_STEP_S = 1e-3
# Shortest substep, whether a step is split in advance or repeated in halves: at 16 m/s, faster than any catheter snaps,
# a body moves in it as far as detection looks ahead.
SHORTEST_STEP_S = LONGEST_STEP_S / 32


class StepSplitter:
    """Splits steps in which a hand or a body moves further than contact detection looks ahead, and judges solved ones.

    A catheter may move by `LOOK_AHEAD_M` in a step, but only by `SLOW_M` if not all of its contacts are priced (it is
    near itself, or the strategy is another), or if it has a guide wire. For steps above a millisecond limits are lower
    in proportion, because speeds change within a step.

    Attributes:
        detected_share: float. How much of the last solved motion is within these limits, at most 1.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        catheter = world.catheter
        every = np.ones(len(catheter.start_m), np.bool_)
        self._catheter_motion = catheter.start_m, catheter.state.position_m, every, every
        self._modes = sampled_modes(world.duct.reduced.basis.Phi)
        is_priced = world.system.strategy.keeps_delassus and catheter.plain_integrator is not None
        # A rod whose rest length grows gains energy in fast motions.
        self._may_move_far = is_priced and catheter.wire is None
        self._shares_per_s = 0.0  # motion in the last substep, in units of the allowed one
        self.detected_share = 1.0

    def compile_kernels(self) -> None:
        """Compile the kernels that only a fast catheter needs."""
        self._most_motion_m()

    def parts(self, tools: ToolInputs, dt_s: float) -> int:
        """Return the number of substeps of a step: a power of two, so that matrices are prepared for few lengths.

        In each of them a hand moves no further than allowed, and neither does a body at its speed in the last substep.
        """
        longer, wanted, parts = max(dt_s / LONGEST_STEP_S, 1.0), self._shares_per_s * dt_s, 1
        if longer * dt_s * FASTEST_HAND_M_S > LOOK_AHEAD_M:
            body = self._world.tools
            away_m = furthest_point(tools.position_m, body.hand, tools.present, body.present)
            wanted = max(wanted, min(away_m, dt_s * FASTEST_HAND_M_S) / LOOK_AHEAD_M)
        while dt_s > parts * SHORTEST_STEP_S and max(longer / parts, 1.0) * wanted > parts:
            parts *= 2
        return parts

    def is_detected(self) -> bool:
        """Return whether catheter and wall moved no further in the solved step than contact detection looked ahead.

        A wall that snaps moves 10 mm in a millisecond: it could pass a jaw that was not among the candidates. Its modes
        tell that anywhere; a thin wall moves as far by its loads alone, near them.
        """
        duct = self._world.duct
        sampled_m, catheter_m = furthest_of((self._modes, duct.q_start, duct.state.q), self._catheter_motion)
        longer, wall_m = max(duct.dt_s / LONGEST_STEP_S, 1.0), max(sampled_m, self._world.search.wall_moved_m)
        share = wall_m / LOOK_AHEAD_M
        if longer * catheter_m > SLOW_M:
            share = max(share, catheter_m / self._most_motion_m())
        self._shares_per_s = share / duct.dt_s
        self.detected_share = 1.0 / max(longer * share, 1.0)
        return self.detected_share == 1.0

    def _most_motion_m(self) -> float:
        """Return how far (m) a catheter that moves by more than `SLOW_M` may move without missing a contact."""
        if not self._may_move_far:
            return SLOW_M
        start_m, effects = self._world.catheter.start_m, self._world.effects
        within_m = min((effect.most_motion_m(start_m) for effect in effects), default=LOOK_AHEAD_M)
        return max(min(LOOK_AHEAD_M, within_m), SLOW_M)


def sampled_modes(Phi: FloatArray) -> FloatArray:
    """Return the rows (3 k, r) of Phi (n, 3, r) at a few nodes."""
    nodes = np.unique(np.linspace(0, len(Phi) - 1, N_NODES).astype(int))
    return np.ascontiguousarray(Phi[nodes].reshape(3 * len(nodes), -1))


def steps_of(tick_s: float, longest_s: float = LONGEST_STEP_S) -> int:
    """Return the number of steps of a tick, a power of two, each at most ``longest_s`` long."""
    steps = 1
    while tick_s > steps * longest_s * (1.0 + 1e-9):
        steps *= 2
    return steps


@summing_kernel
def furthest(modes: FloatArray, before: FloatArray, after: FloatArray) -> float:
    """Return the largest displacement in m of the nodes of ``modes`` (3 n, r) between two coordinates (r,).

    Rates would mislead: those of a wall under contact oscillate within each step.
    """
    largest_2 = 0.0
    for node in range(modes.shape[0] // 3):
        displacement_2 = 0.0
        for axis in range(3):
            displacement = 0.0
            for mode in range(before.shape[0]):
                displacement += modes[3 * node + axis, mode] * (after[mode] - before[mode])
            displacement_2 += displacement * displacement
        largest_2 = max(largest_2, displacement_2)
    return math.sqrt(largest_2)


@kernel
def furthest_point(start: FloatArray, end: FloatArray, present_at_end: BoolArray, present_at_start: BoolArray) -> float:
    """Return the largest displacement in m of the points (n, 3) that are present both at the start and at the end."""
    largest_2 = 0.0
    for i in range(start.shape[0]):
        if present_at_end[i] and present_at_start[i]:
            x, y, z = end[i, 0] - start[i, 0], end[i, 1] - start[i, 1], end[i, 2] - start[i, 2]
            largest_2 = max(largest_2, x * x + y * y + z * z)
    return math.sqrt(largest_2)


@kernel
def furthest_of(
    wall: tuple[FloatArray, FloatArray, FloatArray], catheter: tuple[FloatArray, FloatArray, BoolArray, BoolArray]
) -> tuple[float, float]:
    """Return `furthest` of the wall and `furthest_point` of the catheter, in m."""
    return furthest(wall[0], wall[1], wall[2]), furthest_point(catheter[0], catheter[1], catheter[2], catheter[3])
