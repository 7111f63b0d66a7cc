r"""A viscous film: the tangential force opposes the slip, :math:`f_t = -b\,u_t / \Delta t`; none along the normal.

Its compliance :math:`\Delta t / b` is the row's softness, so that backward Euler solves it whatever the viscosity.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws.ball import relax_in_ball
from services.mechanics.contact.laws.law import ContactProblem, PenaltyGains, Unknowns, add_axes
from services.mechanics.contact.rows import ContactRows

HAS_GAP = False
# So soft along the normal, and where it does not reach, that a film carries no load: 1 N for a million kilometres.
NO_LOAD_M_N = 1e9
# Films that a particle between two walls shares its drag out to.
N_FILMS = 2


@kernel
def open_row(rows: ContactRows, row: int) -> None:
    """Let it carry no load at all, until somebody writes dt / b on its tangents."""
    rows.softness_m_n[row] = NO_LOAD_M_N


@kernel
def relax(problem: ContactProblem, W: FloatArray, block: int) -> None:
    """No motion beyond that of the softness."""
    relax_in_ball(problem, W, block, math.inf)


@kernel
def add_unknowns(problem: ContactProblem, block: int, out: Unknowns, n: int) -> int:
    """All three axes, always."""
    return add_axes(out, n, block)


@kernel
def project(problem: ContactProblem, block: int) -> None:
    """Every force is admitted."""


@kernel
def slides(rows: ContactRows, row: int) -> bool:
    """Its force has no limit to be on."""
    return False


@kernel
def closed_axes(rows: ContactRows, row: int, is_sliding: bool) -> int:
    """A damper is no stiffness."""
    return 0


@kernel
def penalty(rows: ContactRows, row: int, motion: tuple[float, float, float], gains: PenaltyGains) -> None:
    """Write the drag at the rate without contact, but no more than stops a particle between two walls in a step.

    More would throw it back, as the force is explicit.
    """
    force, softness = rows.force_n[row], rows.softness_m_n[row]
    least = N_FILMS * gains.dt_s**2 / gains.lightest_kg
    force[0], force[1], force[2] = 0.0, -motion[1] / max(softness[1], least), -motion[2] / max(softness[2], least)
