"""The paper's contact response: a spring and damper on the depth of penetration, for comparison."""

from __future__ import annotations

import math
from typing import NamedTuple

from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.compiled.vectors import Vector
from trocar.services.mechanics.compiled.vectors import row as row_at
from trocar.services.mechanics.contact.admissible import normal_range, project, tangential_limit
from trocar.services.mechanics.contact.free_motion import free_motion
from trocar.services.mechanics.contact.geometry import Bodies
from trocar.services.mechanics.contact.implicit import ImplicitStrategy
from trocar.services.mechanics.contact.laws import FIXES_DISTANCE, HAS_GAP
from trocar.services.mechanics.contact.rows import ContactRows, in_frame
from trocar.services.mechanics.contact.stages import finish
from trocar.services.mechanics.contact.state import ContactState, state_at
from trocar.services.mechanics.scene import ContactSettings

# Below this sliding speed friction is proportional to the speed (regularised), because an explicit force cannot stick.
SLIP_SPEED_M_S = 1e-3
# Largest number of films on a particle: it may lie between two walls.
FILMS_PER_PARTICLE = 2.0


class PenaltyGains(NamedTuple):
    """Spring and damper of penalty contact, the length of the step, and the smallest mass that a contact acts on."""

    stiffness_n_m: float
    damping_n_s_m: float
    dt_s: float
    lightest_kg: float


class PenaltyStrategy(ImplicitStrategy):
    r"""Explicit forces, from gaps in the middle of the step and their rates over it, both without contact forces.

    They are stable only while :math:`k \Delta t^2` and :math:`c \Delta t` are below about the mass that they act on. A
    load F rests at a depth F / k.
    """

    acts_in_next_step = True
    keeps_delassus = False

    def __init__(self, bodies: Bodies, settings: ContactSettings, state: ContactState) -> None:
        super().__init__(bodies, settings, state)
        self._lightest_kg = float(bodies.catheter.properties.particle_mass_kg().min())

    def assemble(self, first: int = 0, *, anew: bool = False) -> None:
        """Do nothing: penalty contact needs no compliance of the bodies."""

    def solve(self, iterations: int, dt_s: float) -> int:
        """Write the penalty of every contact."""
        spring, damper = self._settings.penalty_stiffness_n_m, self._settings.penalty_damping_n_s_m
        gains = PenaltyGains(spring, damper, dt_s, self._lightest_kg)
        solve_by_penalty(self._address, gains)
        return 0


@kernel
def solve_by_penalty(state_address: Address[ContactState], gains: PenaltyGains) -> None:
    """Find the contact forces from penetrations."""
    state = state_at(state_address)
    free_motion(state.rows, 1.0, gains.dt_s, state.problem.motion)
    write_penalties(state.rows, gains)
    finish(state)


@kernel
def write_penalties(rows: ContactRows, gains: PenaltyGains) -> None:
    """Write the penalty counterpart of every contact's law into ``rows.force_n``."""
    for row in range(rows.n_contacts):
        motion = in_frame(rows, row, row_at(rows.slip_m, row))
        if HAS_GAP[rows.law[row]]:
            _write_surface_force(rows, row, motion, gains)
        else:
            _write_holding_force(rows, row, motion, gains)
        project(rows, row, False)


@kernel
def _write_surface_force(rows: ContactRows, row: int, motion: Vector, gains: PenaltyGains) -> None:
    r"""Write :math:`f_n = \max(0, -k g - c \dot g)` where surfaces overlap, and regularised friction.

    The gap is that in the middle of the step: with the gap at its start, a force held over a step of second order
    would add energy at any stiffness. The damping of a particle is at most what halves its speed in a step. The tension
    of an adhesive law acts at any gap.
    """
    force, gap = rows.force_n[row], rows.gap_m[row] + rows.rest_offset_m[row] + 0.5 * motion[0]
    damping = gains.damping_n_s_m
    if _touches_rod(rows, row):
        damping = min(damping, 0.5 * gains.lightest_kg / gains.dt_s)
    spring, damper = gains.stiffness_n_m * gap, damping * motion[0]
    pressure = max(0.0, -spring - damper / gains.dt_s) if gap < 0.0 else 0.0
    force[0] = pressure + normal_range(rows, row)[0]
    scale = tangential_limit(rows, row) / max(math.hypot(motion[1], motion[2]), SLIP_SPEED_M_S * gains.dt_s)
    force[1], force[2] = -scale * motion[1], -scale * motion[2]


@kernel
def _write_holding_force(rows: ContactRows, row: int, motion: Vector, gains: PenaltyGains) -> None:
    """Write the force that opposes the slip: by the penalty spring at held points, else by the row's softness.

    On a particle the softness is at least that of a force that stops it within one step, divided between
    `FILMS_PER_PARTICLE` films, because a stiffer explicit force would throw it back. Rows of a law without tangential
    forces carry their compliance plus that of the coupling on their tangents.
    """
    min_softness = FILMS_PER_PARTICLE * gains.dt_s**2 / gains.lightest_kg if _touches_rod(rows, row) else 0.0
    for axis in range(3):
        softness = max(rows.softness_m_n[row, axis], min_softness)
        if FIXES_DISTANCE[rows.law[row]]:
            softness = 1.0 / gains.stiffness_n_m
        elif axis == 0:
            softness = max(softness, rows.softness_m_n[row, 1])
        rows.force_n[row, axis] = -motion[axis] / softness


@kernel
def _touches_rod(rows: ContactRows, row: int) -> bool:
    """Return whether the catheter is one of the bodies of a row."""
    n = 0
    for point in range(rows.rod_weight.shape[1]):
        n += rows.rod_weight[row, point] != 0.0
    return n > 0
