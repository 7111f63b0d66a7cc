"""Smallest quadratic forms under a bound on the length: the local problems of friction and of a hold."""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws.law import ContactProblem, carry_change

_NEWTON_STEPS = 12
_CLOSE = 1e-12


@kernel
def bounded_2(a: float, b: float, c: float, r_1: float, r_2: float, radius: float) -> tuple[float, float]:
    r"""Minimise :math:`\tfrac12 f^T W f + r^T f` over :math:`|f| \le radius`, W = ((a, b), (b, c)) positive.

    Inside the disk the motion W f + r vanishes (stick); on its edge W f + r = -lambda f with lambda >= 0, so
    the slip opposes the force (maximal dissipation). lambda by More and Sorensen's Newton iteration (SIAM J.
    Sci. Stat. Comput. 4, 1983, eq. 3.11), which converges from below without overshooting.
    """
    shift = 0.0
    f_1, f_2 = 0.0, 0.0
    for _ in range(_NEWTON_STEPS):
        determinant = (a + shift) * (c + shift) - b * b
        f_1 = (-(c + shift) * r_1 + b * r_2) / determinant
        f_2 = (b * r_1 - (a + shift) * r_2) / determinant
        norm_2 = f_1 * f_1 + f_2 * f_2
        norm = math.sqrt(norm_2)
        if norm <= radius * (1.0 + _CLOSE):
            return f_1, f_2
        g_1 = ((c + shift) * f_1 - b * f_2) / determinant
        g_2 = (-b * f_1 + (a + shift) * f_2) / determinant
        shift += (norm - radius) / radius * norm_2 / (f_1 * g_1 + f_2 * g_2)
    scale = radius / math.sqrt(f_1 * f_1 + f_2 * f_2)
    return scale * f_1, scale * f_2


@kernel
def bounded_3(W: FloatArray, row: int, r: tuple[float, float, float], radius: float, out: FloatArray) -> None:
    """Three-dimensional `bounded_2` for the block of ``W`` at ``row``; the minimiser goes to ``out`` (3,)."""
    shift = 0.0
    for _ in range(_NEWTON_STEPS):
        f_1, f_2, f_3 = solve_3(W, row, shift, -r[0], -r[1], -r[2])
        out[0], out[1], out[2] = f_1, f_2, f_3
        norm_2 = f_1 * f_1 + f_2 * f_2 + f_3 * f_3
        norm = math.sqrt(norm_2)
        if norm <= radius * (1.0 + _CLOSE):
            return
        g_1, g_2, g_3 = solve_3(W, row, shift, f_1, f_2, f_3)
        shift += (norm - radius) / radius * norm_2 / (f_1 * g_1 + f_2 * g_2 + f_3 * g_3)
    scale = radius / math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    for axis in range(3):
        out[axis] *= scale


@kernel
def relax_in_ball(problem: ContactProblem, W: FloatArray, block: int, limit: float) -> None:
    """Solve a contact that allows no motion while its force is within a ball, the others fixed."""
    row, motion, force, change = 3 * block, problem.motion, problem.rows.force_n[block], problem.change
    if limit <= 0.0:
        change[:] = 0.0
    else:
        f_0, f_1, f_2 = force[0], force[1], force[2]
        r_0 = motion[row] - W[row, row] * f_0 - W[row, row + 1] * f_1 - W[row, row + 2] * f_2
        r_1 = motion[row + 1] - W[row + 1, row] * f_0 - W[row + 1, row + 1] * f_1 - W[row + 1, row + 2] * f_2
        r_2 = motion[row + 2] - W[row + 2, row] * f_0 - W[row + 2, row + 1] * f_1 - W[row + 2, row + 2] * f_2
        bounded_3(W, row, (r_0, r_1, r_2), limit, change)
    for axis in range(3):
        step = change[axis] - force[axis]
        force[axis] += step
        carry_change(problem, W, block, axis, step)


@kernel
def way_to_edge(a: float, b: float, c: float) -> float:
    """Return the s in (0, 1] at which :math:`a s^2 + 2 b s + c` comes to zero from ``c`` < 0; 1 if that is beyond."""
    root = b * b - a * c
    if root < 0.0:
        return 1.0
    below = b + math.sqrt(root)
    return min(-c / below, 1.0) if below > 0.0 else 1.0


@kernel
def solve_3(W: FloatArray, row: int, shift: float, r_1: float, r_2: float, r_3: float) -> tuple[float, float, float]:
    """Solve the symmetric positive 3 x 3 block of ``W`` at ``row``, plus ``shift`` on its diagonal (LDL')."""
    d_1 = W[row, row] + shift
    l_21 = W[row + 1, row] / d_1
    l_31 = W[row + 2, row] / d_1
    d_2 = W[row + 1, row + 1] + shift - l_21 * l_21 * d_1
    l_32 = (W[row + 2, row + 1] - l_31 * l_21 * d_1) / d_2
    d_3 = W[row + 2, row + 2] + shift - l_31 * l_31 * d_1 - l_32 * l_32 * d_2
    y_2 = r_2 - l_21 * r_1
    x_3 = (r_3 - l_31 * r_1 - l_32 * y_2) / d_3
    x_2 = y_2 / d_2 - l_32 * x_3
    return r_1 / d_1 - l_21 * x_2 - l_31 * x_3, x_2, x_3
