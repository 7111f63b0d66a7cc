"""Kernels of the implicit step: assemble, solve, correct, and the compliance that contacts see."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .banded import HALF_BANDWIDTH, RHS_BLOCK, factor_ldl, solve_ldl, solve_ldl_block
from .forces import add_internal_forces
from .model import RodModel, RodWork

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
Motion = tuple[FloatArray, FloatArray]


@njit(cache=True, nogil=True, fastmath=False)
def predict(
    model: RodModel, work: RodWork, motion: Motion, external: FloatArray, target: FloatArray,
    step: tuple[float, float, int]
) -> bool:
    """Advance motion = (x, v) in place without contacts; False, and motion as it was, where a number is not finite."""
    x, v = motion
    dt_s, theta, iterations = step
    dv = work.velocity_change
    _start_from_held(model, work, motion, target, (dt_s, theta))
    for _ in range(iterations):
        _assemble(model, work, motion, external, (dt_s, theta))
        _remove_held(model, work)
        if not factor_ldl(work.band):
            return False
        solve_ldl(work.band, work.rhs)
        size = 0.0
        for i in range(x.shape[0]):
            for c in range(3):
                dv[i, c] += work.rhs[3 * i + c]
                size += abs(dv[i, c])
        if not math.isfinite(size):
            return False
    for i in range(x.shape[0]):
        for c in range(3):
            x[i, c] += dt_s * (v[i, c] + theta * dv[i, c])
            v[i, c] += dv[i, c]
    return True


@njit(cache=True, nogil=True, fastmath=False)
def _start_from_held(
    model: RodModel, work: RodWork, motion: Motion, target: FloatArray, step: tuple[float, float]
) -> None:
    """First iterate: free particles go on as they are, held ones reach their target (NaN: stay)."""
    x, v = motion
    dt_s, theta = step
    work.velocity_change[:] = 0.0
    for k in range(model.held.shape[0]):
        i = model.held[k]
        for c in range(3):
            way = 0.0 if np.isnan(target[k, c]) else target[k, c] - x[i, c]
            work.velocity_change[i, c] = (way / dt_s - v[i, c]) / theta


@njit(cache=True, nogil=True, fastmath=False)
def _assemble(
    model: RodModel, work: RodWork, motion: Motion, external: FloatArray, step: tuple[float, float]
) -> None:
    """Residual dt f - M dv into the right-hand side, and A, both at the current iterate."""
    x, v = motion
    dt_s, theta = step
    h = theta * dt_s
    dv = work.velocity_change
    work.band[:] = 0.0
    for i in range(x.shape[0]):
        for c in range(3):
            work.velocity[i, c] = v[i, c] + theta * dv[i, c]
            work.position[i, c] = x[i, c] + h * work.velocity[i, c]
            work.force[i, c] = external[i, c] - model.drag[i] * work.velocity[i, c]
            work.band[3 * i + c, 0] = model.mass[i] + h * model.drag[i]
    add_internal_forces(model, work, (h * h + h * model.beta, h * h), h)
    for i in range(x.shape[0]):
        for c in range(3):
            work.rhs[3 * i + c] = dt_s * work.force[i, c] - model.mass[i] * dv[i, c]
    work.rhs[3 * x.shape[0] :] = 0.0


@njit(cache=True, nogil=True, fastmath=False)
def _remove_held(model: RodModel, work: RodWork) -> None:
    """Take held particles out of the system: unit diagonal, zero couplings, zero right-hand side."""
    for k in range(model.held.shape[0]):
        for c in range(3):
            j = 3 * model.held[k] + c
            work.rhs[j] = 0.0
            for a in range(1, HALF_BANDWIDTH + 1):
                work.band[j, a] = 0.0
                if a <= j:
                    work.band[j - a, a] = 0.0
            work.band[j, 0] = 1.0


@njit(cache=True, nogil=True, fastmath=False)
def correct(
    model: RodModel, work: RodWork, motion: Motion, force: FloatArray, step: tuple[float, float]
) -> None:
    """Add to motion = (x, v) what forces (n, 3), constant over the step, change: dv = dt A^-1 f, dx = theta dt dv."""
    x, v = motion
    dt_s, theta = step
    n = x.shape[0]
    for i in range(n):
        for c in range(3):
            work.rhs[3 * i + c] = 0.0 if model.is_held[i] else dt_s * force[i, c]
    work.rhs[3 * n :] = 0.0
    solve_ldl(work.band, work.rhs)
    for i in range(n):
        for c in range(3):
            v[i, c] += work.rhs[3 * i + c]
            x[i, c] += theta * dt_s * work.rhs[3 * i + c]


@njit(cache=True, nogil=True, fastmath=False)
def compliance(
    model: RodModel, band: FloatArray, gain: float, columns: FloatArray, particles: IntArray, out: FloatArray
) -> None:
    """Fill `out` (3k, 3k) with gain * A^-1 between `particles` (k,), given in ascending order."""
    k = particles.shape[0]
    for start in range(0, 3 * k, RHS_BLOCK):
        stop = min(start + RHS_BLOCK, 3 * k)
        first = 3 * particles[start // 3]
        columns[first:] = 0.0
        for column in range(start, stop):
            p = particles[column // 3]
            columns[3 * p + column % 3, column - start] = 0.0 if model.is_held[p] else gain
        solve_ldl_block(band, first, columns)
        for row in range(start, 3 * k):
            for column in range(start, min(stop, row + 1)):
                out[row, column] = columns[3 * particles[row // 3] + row % 3, column - start]
                out[column, row] = out[row, column]


@njit(cache=True, nogil=True, fastmath=False)
def solve_many(
    model: RodModel, band: FloatArray, gain: float, columns: FloatArray, force: FloatArray, out: FloatArray
) -> None:
    """Fill `out` (n, 3, m) with gain * A^-1 force, RHS_BLOCK right-hand sides at a time."""
    n, _, m = force.shape
    for start in range(0, m, RHS_BLOCK):
        stop = min(start + RHS_BLOCK, m)
        columns[:] = 0.0
        for i in range(n):
            if not model.is_held[i]:
                for c in range(3):
                    for column in range(start, stop):
                        columns[3 * i + c, column - start] = gain * force[i, c, column]
        solve_ldl_block(band, 0, columns)
        for i in range(n):
            for c in range(3):
                for column in range(start, stop):
                    out[i, c, column] = columns[3 * i + c, column - start]
