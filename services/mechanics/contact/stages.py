"""The stages of the contact solve as the simulation calls them: one kernel each, on the state behind one address."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.pairs import pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.contact.compliance import (
    add_modal_compliance,
    add_rod_compliance,
    add_tool_compliance,
    free_motion,
    to_contact_frames,
    world_forces,
)
from services.mechanics.contact.geometry import append_pairs, subtract_duct_motion
from services.mechanics.contact.penalty import penalty_forces
from services.mechanics.contact.solver import mark_sliding, solve_contacts
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.contact.warm_start import recall_forces, store_forces


@kernel
def append(state_address: int, pairs_address: int, count: int) -> int:
    """Append ``count`` pairs to the rows and return how many found no room."""
    state = state_at(state_address)
    tools, rod, duct = state.geometry
    dropped: int = append_pairs(pairs_at(pairs_address), count, tools, rod, duct, state.rows)
    return dropped


@kernel
def measure(
    state_address: int, modes: FloatArray, q: FloatArray, dq: FloatArray, offset: FloatArray, change: FloatArray
) -> None:
    """Finish gaps and slips with the duct's displacement, see `subtract_duct_motion`, and recall last tick's forces."""
    state = state_at(state_address)
    subtract_duct_motion(state.rows, modes, q, dq, offset, change)
    recall_forces(state.memory, state.rows, state.slides)


@kernel
def add_bodies(
    state_address: int, duct: tuple[FloatArray, FloatArray], slot: IntArray, rod: FloatArray, tools: FloatArray
) -> None:
    """Add modes and gains of the duct, catheter (3 p, 3 p) and couplings (2, 4) to the lower blocks of W, world axes.

    What W holds already, the residual compliance, stays.
    """
    state = state_at(state_address)
    size = 3 * state.rows.used[0]
    W = state.compliance[: size * size].reshape(size, size)
    add_modal_compliance(duct[0], duct[1], state.scratch.modes, W)
    add_rod_compliance(state.rows, slot, rod, state.rod_points, W)
    add_tool_compliance(state.rows, tools, W)


@kernel
def turn(state_address: int) -> None:
    """Turn W into the contacts' frames."""
    state = state_at(state_address)
    size = 3 * state.rows.used[0]
    to_contact_frames(state.rows, state.compliance[: size * size].reshape(size, size))


@kernel
def solve(state_address: int, recovery: float, iterations: int, tolerance_n: float) -> int:
    """Find the contact forces from W and return the number of sweeps."""
    state = state_at(state_address)
    rows = state.rows
    k = rows.used[0]
    free_motion(rows, recovery, state.motion)
    sweeps: int = solve_contacts(
        state.compliance[: 9 * k * k].reshape(3 * k, 3 * k),
        state.motion[: 3 * k],
        rows.kind[:k],
        rows.limit[:k],
        rows.force_n[:k].reshape(3 * k),
        (iterations, tolerance_n),
        state.scratch,
    )
    _finish(state)
    return sweeps


@kernel
def push_back(state_address: int, stiffness_n_m: float, damping_n_s_m: float, dt_s: float) -> None:
    """Find the contact forces from penetrations instead, as the paper does."""
    state = state_at(state_address)
    free_motion(state.rows, 1.0, state.motion)
    penalty_forces(state.rows, stiffness_n_m, damping_n_s_m, dt_s)
    _finish(state)


@kernel
def _finish(state: ContactState) -> None:
    """Write who slides and the forces along world axes, and remember both."""
    rows = state.rows
    k = rows.used[0]
    mark_sliding(rows.kind[:k], rows.limit[:k], rows.force_n[:k].reshape(3 * k), state.slides)
    world_forces(rows, state.force_n)
    store_forces(state.memory, rows, state.force_n, state.slides)
