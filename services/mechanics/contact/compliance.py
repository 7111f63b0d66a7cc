"""The contact-space compliance W = J A^-1 J^T of duct, catheter and tools, gathered block by block.

Blocks are built along world axes, where every body's own compliance lies, and turned into the contacts' frames
once at the end. Only the lower triangle is built; W is symmetric because each body's compliance is.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from services.mechanics.contact.pairs import NO_TOOL
from services.mechanics.contact.rows import ContactRows

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]


@njit(cache=True, nogil=True, fastmath=False)
def modal_compliance(modes: FloatArray, gain: FloatArray, scratch: FloatArray, out: FloatArray) -> None:
    """Write modes diag(gain) modes^T, (m, r) by (r,), into ``out`` (m, m) with one matrix product of the BLAS."""
    n_rows, n_modes = modes.shape
    scaled = scratch[: n_rows * n_modes].reshape(n_rows, n_modes)
    for row in range(n_rows):
        for mode in range(n_modes):
            scaled[row, mode] = modes[row, mode] * gain[mode]
    np.dot(scaled, modes.T, out)


@njit(cache=True, nogil=True, fastmath=False)
def add_lower(block: FloatArray, out: FloatArray) -> None:
    """Add the lower triangle of ``block`` (m, m) to ``out`` (m, m)."""
    for row in range(out.shape[0]):
        for column in range(row + 1):
            out[row, column] += block[row, column]


@njit(cache=True, nogil=True, fastmath=False)
def list_particles(rows: ContactRows, slot: IntArray, particles: IntArray) -> int:
    """Fill ``particles`` with those that contacts touch, ascending, and ``slot`` (n,) with their place or -1."""
    slot[:] = -1
    for row in range(rows.used[0]):
        for point in range(rows.rod_node.shape[1]):
            if rows.rod_weight[row, point] != 0.0:
                slot[rows.rod_node[row, point]] = 0
    count = 0
    for particle in range(slot.shape[0]):
        if slot[particle] == 0:
            slot[particle] = count
            particles[count] = particle
            count += 1
    return count


@njit(cache=True, nogil=True, fastmath=False)
def add_rod_compliance(rows: ContactRows, slot: IntArray, rod: FloatArray, out: FloatArray) -> None:
    """Add the catheter's compliance between its touched particles, ``rod`` (3 p, 3 p), to the blocks of ``out``."""
    n_points = rows.rod_node.shape[1]
    for a in range(rows.used[0]):
        for i in range(n_points):
            w_i = rows.rod_weight[a, i]
            if w_i == 0.0:
                continue
            first = 3 * slot[rows.rod_node[a, i]]
            for b in range(a + 1):
                for j in range(n_points):
                    weight = w_i * rows.rod_weight[b, j]
                    if weight != 0.0:
                        _add_block(out, 3 * a, 3 * b, weight, rod, first, 3 * slot[rows.rod_node[b, j]])


@njit(cache=True, nogil=True, fastmath=False)
def _add_block(
    out: FloatArray, row: int, column: int, weight: float, block: FloatArray, first: int, second: int
) -> None:
    for i in range(3):
        for j in range(3):
            out[row + i, column + j] += weight * block[first + i, second + j]


@njit(cache=True, nogil=True, fastmath=False)
def add_tool_compliance(rows: ContactRows, compliance: FloatArray, out: FloatArray) -> None:
    """Add G diag(c) G^T of the contacts of each tool; ``compliance`` (2, 4) is the couplings' c."""
    for a in range(rows.used[0]):
        tool = rows.tool[a]
        if tool == NO_TOOL:
            continue
        for b in range(a + 1):
            if rows.tool[b] != tool:
                continue
            for i in range(3):
                for j in range(3):
                    total = 0.0
                    for k in range(compliance.shape[1]):
                        total += rows.lever[a, i, k] * compliance[tool, k] * rows.lever[b, j, k]
                    out[3 * a + i, 3 * b + j] += total


@njit(cache=True, nogil=True, fastmath=False)
def to_contact_frames(rows: ContactRows, W: FloatArray) -> None:
    """Turn the lower blocks of ``W`` (m, m) into the contacts' frames in place, and mirror them."""
    half = np.empty((3, 3))
    for a in range(rows.used[0]):
        F = rows.frame[a]
        for b in range(a + 1):
            if b == a:
                for i in range(3):
                    for j in range(i + 1, 3):
                        W[3 * a + i, 3 * a + j] = W[3 * a + j, 3 * a + i]
            G = rows.frame[b]
            for i in range(3):
                for j in range(3):
                    half[i, j] = (
                        F[i, 0] * W[3 * a, 3 * b + j]
                        + F[i, 1] * W[3 * a + 1, 3 * b + j]
                        + F[i, 2] * W[3 * a + 2, 3 * b + j]
                    )
            for i in range(3):
                for j in range(3):
                    value = half[i, 0] * G[j, 0] + half[i, 1] * G[j, 1] + half[i, 2] * G[j, 2]
                    W[3 * a + i, 3 * b + j] = value
                    W[3 * b + j, 3 * a + i] = value
        for i in range(3):
            W[3 * a + i, 3 * a + i] += rows.softness_m_n[a, i]


@njit(cache=True, nogil=True, fastmath=False)
def free_motion(rows: ContactRows, recovery: float, out: FloatArray) -> None:
    """Write what the contact law asks to be zero or positive without contact forces into ``out`` (3 k,), in m.

    Normal: the gap at the end of the step. An overlap at the start is a linearisation error of the last tick;
    only the fraction ``recovery`` of it is taken back per tick, because all of it at once would be a velocity.
    """
    for row in range(rows.used[0]):
        for axis in range(3):
            total = 0.0
            for k in range(3):
                total += rows.frame[row, axis, k] * rows.slip_m[row, k]
            out[3 * row + axis] = total
        gap = rows.gap_m[row]
        out[3 * row] += gap if gap > 0.0 else recovery * gap


@njit(cache=True, nogil=True, fastmath=False)
def world_forces(rows: ContactRows, out: FloatArray) -> None:
    """Write the forces on the first bodies along world axes into ``out`` (k, 3), in N."""
    for row in range(rows.used[0]):
        for axis in range(3):
            out[row, axis] = (
                rows.force_n[row, 0] * rows.frame[row, 0, axis]
                + rows.force_n[row, 1] * rows.frame[row, 1, axis]
                + rows.force_n[row, 2] * rows.frame[row, 2, axis]
            )
