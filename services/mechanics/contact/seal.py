"""Friction of the introducer as one contact row: seal and wall of the introducer resist motion along its axis.

The wall's friction is applied at the exit, where the seal is, because the catheter hardly stretches inside.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import AnyArray
from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import between, write_frame
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.identity import pair_identity, with_law
from trocar.services.mechanics.contact.laws import SEAL_SOFTNESS_M_N, number_of
from trocar.services.mechanics.contact.state import ContactState, state_at
from trocar.services.mechanics.contact.system import ContactSystem
from trocar.services.mechanics.contact.writer import FIRST_SIDE, NO_ROOM, append_row, put_on_rod
from trocar.services.mechanics.rod.introducer_normal_force import introducer_normal_force
from trocar.services.mechanics.rod.introducer_passage import closest_on_segment, end_point, find_passage
from trocar.services.mechanics.rod.model import RodModel, model_at

_SEAL = number_of("seal")


class SealMemory(Struct):
    """State of the seal."""

    elastic_m: float = 0.0  # elastic slip along the axis now
    start_m: float = 0.0  # the same at the start of the step
    dissipated_j: float = 0.0  # by slip since the start
    row: int = NO_ROOM


seal_at = reader(SealMemory)


class IntroducerSeal:
    """Elastoplastic friction of an introducer: it slides at its force limit at any speed, and does not creep below it.

    A sleeping catheter needs no row, because the force of the seal is part of its equilibrium.

    Attributes:
        memory: SealMemory. What lasts from step to step.
    """

    def __init__(self, catheter: CatheterBody, system: ContactSystem) -> None:
        self._catheter = catheter
        self._system = system
        self.memory = SealMemory()
        introducer = catheter.integrator.model.introducer
        self._is_there = introducer.is_there and max(introducer.seal, introducer.friction) > 0.0

    @property
    def rows(self) -> range:
        """The row of the seal in this step; empty if it has none."""
        row = self.memory.row
        return range(row, row + 1) if row != NO_ROOM else range(0)

    @property
    def stored_j(self) -> float:
        """Elastic energy of the seal's lip, in J."""
        return 0.5 * self.memory.elastic_m**2 / SEAL_SOFTNESS_M_N

    def step_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that a step changes."""
        return self.memory.own_memory()

    def forget(self) -> None:
        """Remove the row and the elastic slip, so that the seal exerts no force on the catheter where it is now."""
        self.memory.row, self.memory.elastic_m = NO_ROOM, 0.0

    def append_row(self) -> None:
        """Append the seal's row, unless its force limit is zero or the catheter sleeps."""
        n_rows = 0
        if self._is_there and not self._catheter.slept:
            n_rows = append_seal(self._system.address, self._catheter.integrator.model.address, self.memory.address)
        elif self.memory.row != NO_ROOM:
            self.memory.row = NO_ROOM
        self._catheter.n_own_rows = n_rows

    def slide(self, share: float) -> None:
        """Update the elastic slip by the share of the solved motion that has happened."""
        if self._catheter.n_own_rows:
            has_moved = not self._system.strategy.acts_in_next_step
            slide_seal(self._system.address, self.memory.address, has_moved, share)


@kernel
def append_seal(
    state_address: Address[ContactState], model_address: Address[RodModel], seal_address: Address[SealMemory]
) -> int:
    """Append the row of the seal at the point where the rod leaves the introducer, or at the rod's end within it.

    Return the number of rows: 0 if the force limit is zero, or if there is no room for a row.
    """
    state, model, seal = state_at(state_address), model_at(model_address), seal_at(seal_address)
    seal.row, seal.start_m = NO_ROOM, seal.elastic_m
    introducer, rod, rows = model.introducer, state.geometry.rod, state.rows
    x = rod.position
    passage = find_passage(introducer, x)
    limit = introducer.friction * introducer_normal_force(model, x, passage) if introducer.friction > 0.0 else 0.0
    i, s, end = passage.last, 0.0, end_point(introducer, introducer.length)
    if passage.has_exit:
        limit += introducer.seal
        s = closest_on_segment(x, i, end)[0]
    if limit <= 0.0:
        seal.elastic_m = 0.0
        return 0
    row = append_row(rows, _SEAL, with_law(pair_identity(NO_TOOL, 0, -1, 0, 0), _SEAL))
    if row == NO_ROOM:
        return 0
    seal.row, rows.force_limit_n[row] = row, limit
    j = min(i + 1, x.shape[0] - 1)
    put_on_rod(rows, row, FIRST_SIDE, (i, j), (1.0 - s, s))
    slip = between(vector(rod.motion, i), vector(rod.motion, j), s)
    for axis in range(3):
        rows.point_m[row, axis] = end[axis]
        rows.slip_m[row, axis] = slip[axis] + seal.elastic_m * introducer.axis[axis]
    write_frame(introducer.axis, rows.frame[row])
    return 1


@kernel
def slide_seal(
    state_address: Address[ContactState], seal_address: Address[SealMemory], has_moved: bool, share: float
) -> None:
    """Store the elastic slip at the end of the step; ``has_moved`` is whether motions include the contact forces.

    ``share`` of the solved motion has happened. The lip stretches no further than its limit bears: what a solve that
    was cut short has moved it beyond that, it has slid.
    """
    state, seal = state_at(state_address), seal_at(seal_address)
    rows, row = state.rows, seal.row
    force, slip_m = rows.force_n[row, 0], state.problem.motion[3 * row]
    if not has_moved:
        seal.elastic_m = 0.0
        return
    stretch_m = -rows.softness_m_n[row, 0] * force
    if not state.slides[row]:
        most_m = rows.softness_m_n[row, 0] * rows.force_limit_n[row]
        sticking_m = min(max(stretch_m + slip_m, -most_m), most_m) - stretch_m
        stretch_m, slip_m = stretch_m + sticking_m, slip_m - sticking_m
    seal.dissipated_j -= share * force * slip_m
    seal.elastic_m = seal.start_m + share * (stretch_m - seal.start_m)
