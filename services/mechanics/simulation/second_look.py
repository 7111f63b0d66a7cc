"""A second look: what a solved step leads to is looked at where it ends, and solved again with what is met there.

Rows come from detection at the start of a step, which looks ahead as far as things move. The solve then moves them
elsewhere: a wall that snaps beside a row, a catheter that springs off at right angles to where it would have gone
alone, reach each other at points that no row was for. Where surfaces of the step that was solved move by more than
`SECOND_LOOK_M` against each other, or the wall by more than `SNAP_M`, detection looks at bodies as forces leave them,
and pairs that have come deeper into each other than a tolerance get a row at the start of the step: the forces are
taken back, and found once more.
"""

from __future__ import annotations

import math

import numpy as np

from services.mechanics.collision.pairs import NO_TOOL, ContactPairs
from services.mechanics.compiled import kernel
from services.mechanics.compiled.memory import copy_arrays, copy_table
from services.mechanics.compiled.struct import Address
from services.mechanics.contact import laws
from services.mechanics.contact.met import keep_approaching, list_corners
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.reduction.residual.residual_field import THIN_M
from services.mechanics.simulation.pace import furthest_at, sampled_modes
from services.mechanics.world import World

# Surfaces that move no further against each other in a step meet nothing that the first look did not see, unless the
# wall snaps beside them: no hand moves it so far in a step.
SECOND_LOOK_M, SNAP_M = 50e-6, 200e-6
FAR_OF_WALL, SNAP_OF_WALL = 0.25, 1.0
# Overlaps that are left alone: no deeper than this, nor than this part of the wall.
TOLERANCE_M = 30e-6
TOLERANCE_OF_WALL = 0.125
# A thin wall has folds between folds in the jaws: what the rows of a look keep out comes through beside them.
MOST_LOOKS, MOST_LOOKS_AT_THIN = 3, 8


class SecondLook:
    """Looks where a solved step ends, in a world whose contacts act within the step.

    Attributes
    ----------
    looks, met : int
        Steps that were looked at, and rows that came of it, since the start.
    most : int
        So often a step is looked at, at most.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        duct, catheter, tools = world.duct, world.catheter, world.tools
        live = [*duct.given_arrays(), *catheter.given_arrays(), *tools.given_arrays()]
        self._kept = [array.copy() for array in live]
        self._keep, self._take_back = copy_table(self._kept, live), copy_table(live, self._kept)
        self._touched = catheter.touched
        self._modes, self._longest = sampled_modes(duct.reduced.basis.Phi)
        capacity = world.scene.contact.capacity
        self._pairs = ContactPairs.allocate(capacity)
        self._nodes, self._corners = np.zeros(3 * capacity, np.int32), np.zeros((3 * capacity, 3))
        self._tolerance_m = min(TOLERANCE_M, TOLERANCE_OF_WALL * world.scene.duct.thickness_m)
        self._far_m = min(SECOND_LOOK_M, FAR_OF_WALL * world.scene.duct.thickness_m)
        self._snap_m = min(SNAP_M, SNAP_OF_WALL * world.scene.duct.thickness_m)
        self.most = MOST_LOOKS_AT_THIN if world.scene.duct.thickness_m < THIN_M else MOST_LOOKS
        self._is_off = not world.system.strategy.knows_stiffness or catheter.plain_integrator is None
        self.looks = self.met = 0

    def prepare(self) -> None:
        """Note the bodies before forces are given to them, if there are any."""
        if not self._is_off and self._world.system.rows.n_contacts > 0:
            copy_arrays(self._keep)
            self._touched = self._world.catheter.touched

    def is_due(self) -> bool:
        """Whether the forces that were given move anything so far that it may have met what no row is for."""
        system, duct = self._world.system, self._world.duct
        if self._is_off or system.rows.n_contacts == 0:
            return False
        if slides_far(system.address, self._far_m):
            return True
        wall_m: float = furthest_at(self._modes, self._longest, duct.q_start, duct.state.q, self._snap_m)
        return wall_m > self._snap_m

    def append_rows(self, *, knows_tools: bool) -> bool:
        """Look where the bodies are now, take the forces back, append rows of what is met, and return whether any.

        ``knows_tools`` is whether detection has looked for the tools' pairs at the start of this step.
        """
        world, search, pairs = self._world, self._world.search, self._pairs
        self.looks += 1
        pairs.clear()
        if not knows_tools:
            search.take_up_tools(world.catheter, world.tools, pairs)
            pairs.clear()
        world.tools.update_pose()
        search.end_pairs(world.duct, world.catheter, world.tools, pairs)
        self._go_back()
        search.start(world.duct)
        geometry = world.system.geometry
        n = list_corners(pairs.address, geometry.wall.triangles, self._nodes)
        search.node_positions(self._nodes[:n], self._corners[:n])
        keep_approaching(pairs.address, world.system.address, self._corners)
        met = world.system.append_met(pairs, self._tolerance_m) if pairs.count else 0
        self.met += met
        return met > 0

    def compile_kernels(self, pairs: ContactPairs | None = None) -> None:
        """Compile what a look asks for, also with such pairs: the first may come late, while a loop runs."""
        if self._is_off:
            return
        copy_arrays(self._keep)
        self.append_rows(knows_tools=pairs is None)
        if pairs is not None:
            self._world.search.node_positions(self._nodes[:3], self._corners[:3])
            self._world.system.append_met(pairs, -math.inf)

    def _go_back(self) -> None:
        copy_arrays(self._take_back)
        self._world.catheter.touched = self._touched


@kernel
def slides_far(state_address: Address[ContactState], far_m: float) -> bool:
    """Return whether any two surfaces that have a row move against each other by more than ``far_m`` in the step.

    A particle is as far from everything as its nearest row's gap, and may go so much further. Walls bulge beside tools.
    """
    state = state_at(state_address)
    rows, motion = state.rows, state.problem.motion
    for row in range(rows.n_contacts):
        if laws.HAS_GAP[rows.law[row]]:
            nearer = motion[3 * row] - max(rows.gap_m[row] + rows.pad_m[row], 0.0)
            went_2 = nearer * nearer + motion[3 * row + 1] ** 2 + motion[3 * row + 2] ** 2
            if went_2 > far_m * far_m and went_2 > (far_m + _room(rows, row)) ** 2:
                return True
    return False


@kernel
def _room(rows: ContactRows, row: int) -> float:
    """Return how far a row's particle is from everything, its segment too: as its nearest row; 0 beside a tool."""
    if rows.tool[row] != NO_TOOL:
        return 0.0
    least: float = max(rows.gap_m[row], 0.0)
    for other in range(rows.n_contacts):
        is_its = rows.rod_node[other, 0] == rows.rod_node[row, 0] and rows.tool[other] == NO_TOOL
        if is_its and rows.rod_weight[other, 0] * rows.rod_weight[row, 0] > 0.0 and laws.HAS_GAP[rows.law[other]]:
            least = min(least, max(rows.gap_m[other], 0.0))
    return least
