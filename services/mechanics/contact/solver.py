"""Projected block Gauss-Seidel for contact and Coulomb friction on a dense contact-space compliance."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from services.mechanics.contact.ball import bounded_2, bounded_3

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]
ByteArray = npt.NDArray[np.int8]
BoolArray = npt.NDArray[np.bool_]

UNILATERAL, HOLD = 0, 1
# The solver puts a sliding force on its limit to rounding; anything closer than this is on it.
ON_THE_LIMIT = 1.0 - 1e-9


@njit(cache=True, nogil=True, fastmath=False)
def solve_contacts(
    W: FloatArray,
    motion: FloatArray,
    kind: ByteArray,
    limit: FloatArray,
    force: FloatArray,
    iterations: int,
    tolerance_n: float,
) -> int:
    r"""Solve the contact problem of one step in place and return the number of sweeps.

    With the motion :math:`u = W f + u_{free}` each block of three rows (normal, tangent, tangent) obeys

    - unilateral: :math:`0 \le u_n \perp f_n \ge 0` and Coulomb's law with maximal dissipation,
      :math:`|f_t| \le \mu f_n`, sliding against :math:`f_t`;
    - hold: :math:`u = 0` while :math:`|f| \le limit`, else slip against :math:`f`.

    Numerically: a sweep solves each block exactly with the others fixed, normal first, then tangent in its
    cone. The cost is bounded by ``iterations`` sweeps of (3 k)^2 multiplications; started from the last tick's
    forces it usually stops early. Forces are inside their cones, converged or not.

    Parameters
    ----------
    W : (m, m) float64
        Contact-space compliance in m/N, symmetric positive, m = 3 k.
    motion : (m,) float64
        In: gap (normal rows) and slip (tangential rows) at the end of the step without contact forces, in m.
        Out: the same with them.
    kind : (k,) int8
        `UNILATERAL` or `HOLD`.
    limit : (k,) float64
        Coefficient of friction, or the largest force of a hold in N; zero means frictionless, or no hold.
    force : (m,) float64
        Start values in, solution out.
    iterations : int
    tolerance_n : float
        Stop when no force component changed by more in a sweep.
    """
    n_blocks = kind.shape[0]
    change = np.empty(3)
    for row in range(3 * n_blocks):
        _add_row(motion, W, row, force[row])
    for sweep in range(iterations):
        largest = 0.0
        for block in range(n_blocks):
            row = 3 * block
            if kind[block] == UNILATERAL:
                _relax_unilateral(W, motion, limit[block], force, row, change)
            else:
                _relax_hold(W, motion, limit[block], force, row, change)
            largest = max(largest, abs(change[0]), abs(change[1]), abs(change[2]))
        if largest <= tolerance_n:
            return sweep + 1
    return iterations


@njit(cache=True, nogil=True, fastmath=False)
def _add_row(motion: FloatArray, W: FloatArray, row: int, change: float) -> None:
    """Keep ``motion`` up to date; an update along a row of the symmetric W vectorises, a dot would not."""
    if change != 0.0:
        for column in range(motion.shape[0]):
            motion[column] += W[row, column] * change


@njit(cache=True, nogil=True, fastmath=False)
def _relax_unilateral(
    W: FloatArray, motion: FloatArray, mu: float, force: FloatArray, row: int, change: FloatArray
) -> None:
    """Exact normal force for fixed friction, then exact friction for the new normal force."""
    normal = max(0.0, force[row] - motion[row] / W[row, row])
    change[0] = normal - force[row]
    force[row] = normal
    _add_row(motion, W, row, change[0])
    f_1, f_2 = 0.0, 0.0
    if mu * normal > 0.0:
        a, b, c = W[row + 1, row + 1], W[row + 1, row + 2], W[row + 2, row + 2]
        r_1 = motion[row + 1] - a * force[row + 1] - b * force[row + 2]
        r_2 = motion[row + 2] - b * force[row + 1] - c * force[row + 2]
        f_1, f_2 = bounded_2(a, b, c, r_1, r_2, mu * normal)
    change[1] = f_1 - force[row + 1]
    change[2] = f_2 - force[row + 2]
    force[row + 1] = f_1
    force[row + 2] = f_2
    _add_row(motion, W, row + 1, change[1])
    _add_row(motion, W, row + 2, change[2])


@njit(cache=True, nogil=True, fastmath=False)
def _relax_hold(
    W: FloatArray, motion: FloatArray, limit: float, force: FloatArray, row: int, change: FloatArray
) -> None:
    """No motion inside the ball of the largest force, slip against the force on its edge."""
    if limit <= 0.0:
        change[:] = 0.0
    else:
        f_0, f_1, f_2 = force[row], force[row + 1], force[row + 2]
        r_0 = motion[row] - W[row, row] * f_0 - W[row, row + 1] * f_1 - W[row, row + 2] * f_2
        r_1 = motion[row + 1] - W[row + 1, row] * f_0 - W[row + 1, row + 1] * f_1 - W[row + 1, row + 2] * f_2
        r_2 = motion[row + 2] - W[row + 2, row] * f_0 - W[row + 2, row + 1] * f_1 - W[row + 2, row + 2] * f_2
        bounded_3(W, row, (r_0, r_1, r_2), limit, change)
    for axis in range(3):
        change[axis] -= force[row + axis]
        force[row + axis] += change[axis]
        _add_row(motion, W, row + axis, change[axis])


@njit(cache=True, nogil=True, fastmath=False)
def mark_sliding(kind: ByteArray, limit: FloatArray, force: FloatArray, slides: BoolArray) -> None:
    """Write for each block (k,) whether its friction is on its limit, or its hold slips."""
    for block in range(kind.shape[0]):
        f_n, f_1, f_2 = force[3 * block], force[3 * block + 1], force[3 * block + 2]
        tangent = math.hypot(f_1, f_2)
        if kind[block] == UNILATERAL:
            slides[block] = f_n > 0.0 and tangent >= ON_THE_LIMIT * limit[block] * f_n
        else:
            slides[block] = math.hypot(f_n, tangent) >= ON_THE_LIMIT * limit[block]
