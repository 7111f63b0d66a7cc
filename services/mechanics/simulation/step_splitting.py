"""Splits steps into substeps, so that no body moves further in one than contact detection looks ahead."""

from __future__ import annotations

import math
from enum import Enum
from typing import Annotated

import numpy as np

from services.mechanics.arrays import BoolArray, FloatArray
from services.mechanics.bodies.forceps.sweep import FASTEST_HAND_M_S
from services.mechanics.collision.candidate_list import LOOK_AHEAD_M, MAX_LOOK_AHEAD_M
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.world import World

# Number of wall nodes whose speed is sampled; they suffice because fast modes have long wavelengths.
N_NODES = 32
# Longest step, unless the quality level allows more: contacts act as impulses at its start, which make the wall
# oscillate by half of its deflection.
LONGEST_STEP_S = 1e-3
# Shortest substep, whether a step is split in advance or repeated in halves: at 16 m/s, faster than any catheter snaps,
# a body moves in it as far as detection looks ahead.
SHORTEST_STEP_S = LONGEST_STEP_S / 32


class Moving(Struct):
    """Arrays for the speed of a world: velocities of n particles; r modal coordinates before and after a step."""

    velocity: Annotated[FloatArray, "n", 3]
    before: Annotated[FloatArray, "r"]
    after: Annotated[FloatArray, "r"]


moving_at = reader(Moving)


class Verdict(Enum):
    """What becomes of a solved step: it is accepted, or repeated with longer candidate lists or in halves."""

    ACCEPT = 0
    LOOK_FURTHER = 1
    HALVE = 2


class StepSplitter:
    """Splits long ticks, and steps in which something would move further than contact detection looks ahead.

    A step of 1 ms is split above a speed of 2 m/s. The limit is 0.5 m/s for a catheter not all of whose contacts are
    priced (it is near itself, or the strategy is another), and for one with a guide wire. For longer steps the limits
    are lower in proportion, because speeds change within a step.

    Attributes:
        moved_m: float. How far the catheter moved in the step that was solved last.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        catheter, duct = world.catheter, world.duct
        velocity = catheter.state.velocity_m_s
        self._moving = Moving(velocity=velocity, before=duct.q_start, after=duct.state.q)
        every = np.ones(len(velocity), np.bool_)
        self._catheter_motion = catheter.start_m, catheter.state.position_m, every, every
        self._modes, self._longest = sampled_modes(world.duct.reduced.basis.Phi)
        is_priced = world.system.strategy.keeps_delassus and catheter.plain_integrator is not None
        self._may_look_far = (
            is_priced and catheter.wire is None
        )  # a rod whose rest length grows gains energy in such motions
        self.moved_m = 0.0

    def compile_kernels(self) -> None:
        """Compile the kernels that only a fast wall needs."""
        furthest(self._modes, self._world.duct.q_start, self._world.duct.state.q)
        tools = self._world.tools
        furthest_point(tools.port_m, tools.hand, tools.present, tools.present)
        self._most_motion_m(self._world.catheter.start_m, MAX_LOOK_AHEAD_M)

    def parts(self, tools: ToolInputs, dt_s: float) -> tuple[int, float]:
        """Return the number of substeps of a step, and how far anything moves in one, in m.

        The number is a power of two, so that matrices are prepared for few lengths.
        """
        world = self._world
        duct, body = world.duct, world.tools
        speed_m_s, modal_change = speed_and_modal_change(self._moving.address)
        moved_m, last_s = speed_m_s * dt_s, duct.dt_s
        share = min(LONGEST_STEP_S / dt_s, 1.0)
        most_m, seen_m = share * MAX_LOOK_AHEAD_M, share * LOOK_AHEAD_M
        if last_s > 0.0:
            scale = dt_s / last_s
            if self._longest * modal_change * scale > seen_m:
                moved_m = max(moved_m, furthest(self._modes, duct.q_start, duct.state.q) * scale)
        if dt_s * FASTEST_HAND_M_S > seen_m:
            away_m = furthest_point(tools.position_m, body.hand, tools.present, body.present)
            moved_m = max(moved_m, min(away_m, dt_s * FASTEST_HAND_M_S))
        free_m = share * self._most_motion_m(world.catheter.state.position_m, speed_m_s * dt_s / share)
        parts = 1
        while dt_s > parts * SHORTEST_STEP_S and (moved_m > parts * most_m or speed_m_s * dt_s > parts * free_m):
            parts *= 2
        return parts, moved_m / parts

    def judge(self, reach_m: float) -> Verdict:
        """Return whether catheter and wall moved no further in the solved step than contact detection looked ahead.

        A wall that snaps moves 10 mm in a millisecond: it could pass a jaw that was not among the candidates.
        ``reach_m`` is how far the candidate lists of the catheter reach.
        """
        self.moved_m = furthest_point(*self._catheter_motion)
        most_m = self._most_motion_m(self._world.catheter.start_m, self.moved_m)
        if reach_m < self.moved_m <= most_m:
            return Verdict.LOOK_FURTHER
        duct, modal_change = self._world.duct, speed_and_modal_change(self._moving.address)[1]
        moved_m = self._longest * modal_change  # an upper bound
        if moved_m > MAX_LOOK_AHEAD_M:
            moved_m = furthest(self._modes, duct.q_start, duct.state.q)
        return Verdict.ACCEPT if moved_m <= MAX_LOOK_AHEAD_M and self.moved_m <= most_m else Verdict.HALVE

    def _most_motion_m(self, particles_m: FloatArray, moved_m: float) -> float:
        """Return how far (m) particles at (n, 3) may move without missing a contact, if they move by ``moved_m``."""
        if moved_m <= LOOK_AHEAD_M or not self._may_look_far:
            return LOOK_AHEAD_M
        within_m = min((effect.most_motion_m(particles_m) for effect in self._world.effects), default=MAX_LOOK_AHEAD_M)
        return max(min(MAX_LOOK_AHEAD_M, within_m), LOOK_AHEAD_M)


def sampled_modes(Phi: FloatArray) -> tuple[FloatArray, float]:
    """Return rows (3 k, r) of Phi (n, 3, r) at a few nodes, and the largest displacement there per norm of q.

    That factor bounds their motion cheaply; mostly the bound decides.
    """
    nodes = np.unique(np.linspace(0, len(Phi) - 1, N_NODES).astype(int))
    modes = np.ascontiguousarray(Phi[nodes].reshape(3 * len(nodes), -1))
    return modes, float(np.sqrt((modes**2).reshape(len(nodes), -1).sum(axis=1).max()))


def steps_of(tick_s: float, longest_s: float = LONGEST_STEP_S) -> int:
    """Return the number of steps of a tick, a power of two, each at most ``longest_s`` long."""
    steps = 1
    while tick_s > steps * longest_s * (1.0 + 1e-9):
        steps *= 2
    return steps


@kernel
def speed_and_modal_change(address: Address[Moving]) -> tuple[float, float]:
    """Return the largest speed of the particles, and the Euclidean norm of the change of the coordinates."""
    moving = moving_at(address)
    velocity, before, after = moving.velocity, moving.before, moving.after
    largest_2, total = 0.0, 0.0
    for i in range(velocity.shape[0]):
        largest_2 = max(largest_2, velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2)
    for mode in range(before.shape[0]):
        total += (after[mode] - before[mode]) ** 2
    return math.sqrt(largest_2), math.sqrt(total)


@kernel
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
