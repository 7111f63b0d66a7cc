"""Response of an implicit step to contact forces: kernels on the factorised matrix of implicit Euler."""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.rod.banded import HALF_BANDWIDTH, RHS_BLOCK, factor_ldl, solve_ldl, solve_ldl_block
from trocar.services.mechanics.rod.generalized_alpha import implicit_euler
from trocar.services.mechanics.rod.implicit_kernels import Addresses, Motion, assemble_again, remove_held
from trocar.services.mechanics.rod.model import RodModel, RodWork, model_at, work_at


@kernel
def factor_for_contacts(addresses: Addresses, dt_s: float) -> bool:
    """Factorise A = M + dt C + dt^2 K, with K at the position of the last prediction; return False if it is not SPD."""
    return bool(_factor(model_at(addresses[0]), work_at(addresses[1]), dt_s))


@kernel
def _factor(model: RodModel, work: RodWork, dt_s: float) -> bool:
    assemble_again(model, work, implicit_euler(dt_s))
    remove_held(model, work)
    return bool(factor_ldl(work.band))


@kernel
def correct(addresses: Addresses, motion: Motion, force: FloatArray, step: tuple[float, bool]) -> bool:
    """Add to motion = (x, v) its change by contact forces f (n, 3): dv = dt A^-1 f, dx = dt dv.

    ``step`` is (dt, whether A is factorised); A is factorised if necessary. If A is not SPD, return False and change
    nothing.
    """
    model, work, (x, v), (dt_s, is_factored) = model_at(addresses[0]), work_at(addresses[1]), motion, step
    if not (is_factored or _factor(model, work, dt_s)):
        return False
    n = x.shape[0]
    for i in range(n):
        for c in range(3):
            work.rhs[3 * i + c] = 0.0 if model.is_held[i] else dt_s * force[i, c]
    work.rhs[3 * n :] = 0.0
    solve_ldl(work.band, work.rhs)
    for i in range(n):
        for c in range(3):
            v[i, c] += work.rhs[3 * i + c]
            x[i, c] += dt_s * work.rhs[3 * i + c]
    return True


@kernel
def compliance(
    address: Address[RodModel],
    band: FloatArray,
    gain: float,
    columns: FloatArray,
    particles: IntArray,
    out: FloatArray,
) -> None:
    """Fill ``out`` (3k, 3k) with gain * A^-1 between ``particles`` (k,), given in ascending order."""
    model, k = model_at(address), particles.shape[0]
    for start in range(0, 3 * k, RHS_BLOCK):
        stop = min(start + RHS_BLOCK, 3 * k)
        first = 3 * particles[start // 3]
        columns[first:] = 0.0  # from eight rows before the first unknown on
        for column in range(start, stop):
            p = particles[column // 3]
            columns[HALF_BANDWIDTH + 3 * p + column % 3, column - start] = 0.0 if model.is_held[p] else gain
        solve_ldl_block(band, first, columns)
        for row in range(start, 3 * k):
            unknown = HALF_BANDWIDTH + 3 * particles[row // 3] + row % 3
            for column in range(start, min(stop, row + 1)):
                out[row, column] = columns[unknown, column - start]
                out[column, row] = out[row, column]


@kernel
def solve_many(
    address: Address[RodModel], band: FloatArray, gain: float, columns: FloatArray, force: FloatArray, out: FloatArray
) -> None:
    """Fill ``out`` (n, 3, m) with gain * A^-1 force, RHS_BLOCK right-hand sides at a time."""
    model, (n, _, m) = model_at(address), force.shape
    for start in range(0, m, RHS_BLOCK):
        stop = min(start + RHS_BLOCK, m)
        columns[:] = 0.0
        for i in range(n):
            if not model.is_held[i]:
                for c in range(3):
                    for column in range(start, stop):
                        columns[HALF_BANDWIDTH + 3 * i + c, column - start] = gain * force[i, c, column]
        solve_ldl_block(band, 0, columns)
        for i in range(n):
            for c in range(3):
                for column in range(start, stop):
                    out[i, c, column] = columns[HALF_BANDWIDTH + 3 * i + c, column - start]
