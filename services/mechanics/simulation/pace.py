"""How far anything moves in a step, and in how many parts it is taken for nothing to move past what it has not met."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from services.mechanics.arrays import BoolArray, FloatArray
from services.mechanics.bodies.forceps.sweep import FASTEST_HAND_M_S
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.contact.working_set import FASTEST_AHEAD_M, MOST_AHEAD_M
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.world import World

# Nodes of the wall that say how fast it moves: modes that are fast are long.
N_NODES = 32
# No longer step is taken, unless a rung of the quality ladder says so: contacts act by impulses at its start, which
# swing the wall by half of what they hold.
LONGEST_STEP_S = 1e-3
# No shorter one is taken than this either, whether it was split before or is taken again in halves: what goes 16 m/s,
# faster than any catheter snaps, goes as far in it as is seen ahead.
SHORTEST_STEP_S = LONGEST_STEP_S / 32


class Moving(Struct):
    """What says how fast a world moves: velocities of n particles; r coordinates before and after the last step."""

    velocity: Annotated[FloatArray, "n", 3]
    before: Annotated[FloatArray, "r"]
    after: Annotated[FloatArray, "r"]


moving_at = reader(Moving)


class Pace:
    """Splits ticks that are long, and steps in which something moves further than contacts are seen ahead.

    At a step of 1 ms that begins at two metres a second of the wall, and at half a metre a second of the catheter: what
    it meets beside the wall, tools and itself, no price sees. Longer steps are split by as much sooner: within them
    things reach other speeds than they had when they were looked at.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        catheter, duct = world.catheter, world.duct
        velocity = catheter.state.velocity_m_s
        self._moving = Moving(velocity=velocity, before=duct.q_start, after=duct.state.q)
        every = np.ones(len(velocity), np.bool_)
        self._way = catheter.start_m, catheter.state.position_m, every, every
        self._modes, self._longest = sampled_modes(world.duct.reduced.basis.Phi)

    def compile_kernels(self) -> None:
        """Compile what only a wall that moves far asks for."""
        furthest(self._modes, self._world.duct.q_start, self._world.duct.state.q)
        tools = self._world.tools
        furthest_point(tools.port_m, tools.hand, tools.present, tools.present)

    def parts(self, tools: ToolInputs, dt_s: float) -> tuple[int, float]:
        """Return the number of parts of a step, and how far anything moves in one, in m.

        It is a power of two, so that few lengths of a step have to be prepared.
        """
        world = self._world
        duct, body = world.duct, world.tools
        speed_m_s, way = speed_and_way(self._moving.address)
        moved_m, last_s = speed_m_s * dt_s, duct.dt_s
        share = min(LONGEST_STEP_S / dt_s, 1.0)
        most_m, seen_m = share * FASTEST_AHEAD_M, share * MOST_AHEAD_M
        if last_s > 0.0:
            scale = dt_s / last_s
            if self._longest * way * scale > seen_m:
                moved_m = max(moved_m, furthest(self._modes, duct.q_start, duct.state.q) * scale)
        if dt_s * FASTEST_HAND_M_S > seen_m:
            away_m = furthest_point(tools.position_m, body.hand, tools.present, body.present)
            moved_m = max(moved_m, min(away_m, dt_s * FASTEST_HAND_M_S))
        parts = 1
        while dt_s > parts * SHORTEST_STEP_S and (moved_m > parts * most_m or speed_m_s * dt_s > parts * seen_m):
            parts *= 2
        return parts, moved_m / parts

    def is_seen(self) -> bool:
        """Return whether catheter and wall went no further in the solved step than contacts were seen ahead of them.

        A wall that snaps goes 10 mm in a millisecond: past a jaw that was beyond all candidates, to its other side.
        """
        duct, way = self._world.duct, speed_and_way(self._moving.address)[1]
        moved_m = self._longest * way  # no node has gone further
        if moved_m > FASTEST_AHEAD_M:
            moved_m = furthest(self._modes, duct.q_start, duct.state.q)
        return bool(moved_m <= FASTEST_AHEAD_M and furthest_point(*self._way) <= MOST_AHEAD_M)


def sampled_modes(Phi: FloatArray) -> tuple[FloatArray, float]:
    """Return the rows (3 k, r) of a few nodes' modes, of Phi (n, 3, r), and how far they go per way of the coordinates.

    No node of them moves further than that times the way: mostly that is all there is to know.
    """
    nodes = np.unique(np.linspace(0, len(Phi) - 1, N_NODES).astype(int))
    modes = np.ascontiguousarray(Phi[nodes].reshape(3 * len(nodes), -1))
    return modes, float(np.sqrt((modes**2).reshape(len(nodes), -1).sum(axis=1).max()))


def steps_of(tick_s: float, longest_s: float = LONGEST_STEP_S) -> int:
    """Return in how many steps a tick is taken, a power of two: one up to ``longest_s``."""
    steps = 1
    while tick_s > steps * longest_s * (1.0 + 1e-9):
        steps *= 2
    return steps


@kernel
def speed_and_way(address: Address[Moving]) -> tuple[float, float]:
    """Return the largest speed of the particles, and the Euclidean distance of the coordinates."""
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
    """Return the longest way in m of nodes whose rows ``modes`` (3 n, r) has, between coordinates (r,).

    Rates would not do: those of a wall that is pressed on swing within each step.
    """
    largest_2 = 0.0
    for node in range(modes.shape[0] // 3):
        way_2 = 0.0
        for axis in range(3):
            way = 0.0
            for mode in range(before.shape[0]):
                way += modes[3 * node + axis, mode] * (after[mode] - before[mode])
            way_2 += way * way
        largest_2 = max(largest_2, way_2)
    return math.sqrt(largest_2)


@kernel
def furthest_point(start: FloatArray, end: FloatArray, are_there: BoolArray, were_there: BoolArray) -> float:
    """Return how far in m those points (n, 3) go that are there twice, from the start to the end, or back."""
    largest_2 = 0.0
    for i in range(start.shape[0]):
        if are_there[i] and were_there[i]:
            x, y, z = end[i, 0] - start[i, 0], end[i, 1] - start[i, 1], end[i, 2] - start[i, 2]
            largest_2 = max(largest_2, x * x + y * y + z * z)
    return math.sqrt(largest_2)
