r"""Compliance of wall and catheter to a load that lasts for several steps, for the local stiffness at a tool.

The Delassus operator of a step is the compliance to an impulse: mostly inertia, :math:`m / \Delta t^2`, which the body
has overcome a step later. A servo uses a local model for several ticks :math:`\tau`, in which the hand moves smoothly.
The stiffness that the hand feels is then that of one step of backward Euler of this length. The compliance of the
catheter is :math:`\tau^2 (M + \tau C + \tau^2 K)^{-1}`, and that of a mode of the wall
:math:`\tau^2 / (1 + 2 \zeta \omega \tau + \omega^2 \tau^2)`. It is symmetric and positive definite, and the stiffness
approaches the static one from above as the step grows.

The sums over modes are of products in single precision, which takes half the time: they are added to W, and an error of
1e-7 of the wall's compliance is far below that of the surfaces, without which no two contacts share a load.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.bodies.catheter import CatheterTouch, touch_at
from trocar.services.mechanics.bodies.duct_loads import DuctLoads, loads_at
from trocar.services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.compiled import inlined_kernel, kernel, summing_kernel
from trocar.services.mechanics.compiled.struct import Address, Struct
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.rod.contact_response import compliance, factor_for_contacts
from trocar.services.mechanics.rod.model import RodModel, RodWork, work_at

#: Time for which a servo uses a local model without an update.
LASTING_S = 5e-3

WallAddress = Address[DuctLoads]
RodAddresses = tuple[Address[CatheterTouch], Address[RodModel], Address[RodWork], bool]
"""Arrays of a catheter, and whether its step is implicit; of others only the compliance of one step is known."""


class LastingArrays(Struct):
    """Compliances over `LASTING_S`, and work space for m axes and a catheter of n particles.

    The first r of s shapes are those of the modes, the others the coordinates of a tool.
    """

    modes: Annotated[FloatArray, "r"]  # change of a modal coordinate per modal force that lasts for `LASTING_S`
    excess: Annotated[Float32Array, "s"]  # the same, minus the change by the impulse of one step
    shapes: Annotated[Float32Array, "m", "s"]  # shapes along the axes
    moved: Annotated[Float32Array, "s"]  # what a unit force along an axis adds to their coordinates
    particles: Annotated[IntArray, "n"]  # on which the axes act, ascending
    slot: Annotated[IntArray, "n"]  # place of each particle among these, -1 for others
    compliance: Annotated[FloatArray, "9 n n"]
    along: Annotated[FloatArray, "3 n"]
    is_definite: bool = False  # whether the catheter's matrix for `LASTING_S` has factors

    @classmethod
    def of(cls, omega_rad_s: FloatArray, damping_ratio: FloatArray, n_particles: int, n_axes: int) -> LastingArrays:
        """Return room for ``n_axes`` axes on modes of these angular frequencies and damping ratios, both (r,)."""
        t, n, r = LASTING_S, n_particles, len(omega_rad_s)
        modes = t**2 / (1.0 + 2.0 * damping_ratio * omega_rad_s * t + (omega_rad_s * t) ** 2)
        extents = {"n": n, "9 n n": 9 * n * n, "3 n": 3 * n, "r": r, "s": r + N_COORDINATES}
        return cls.zeros(modes=np.asarray(modes, np.float64), m=n_axes, **extents)


@kernel
def add_compliance_of_shapes(
    rows: ContactRows,
    closed: IntArray,
    wall: WallAddress,
    tool: tuple[ToolArrays, int, FloatArray],
    lasting: LastingArrays,
    out: FloatArray,
) -> None:
    """Add the wall's compliance beyond that of one step to ``out`` (k, k), the compliance of closed axes (k, 2).

    ``tool`` is (tools, one of them, levers (k, 4) of its axes): the compliance of its coupling over one step, which
    includes the dampers, is replaced by that of its springs. Only the lower triangle is written.
    """
    duct, (tools, at, levers), excess, shapes = loads_at(wall), tool, lasting.excess, lasting.shapes
    n_modes = lasting.modes.shape[0]
    for mode in range(n_modes):
        excess[mode] = lasting.modes[mode] - duct.gains[0, mode]
    for coordinate in range(levers.shape[1]):
        excess[n_modes + coordinate] = 1.0 / tools.stiffness[at, coordinate] - tools.compliance[at, coordinate]
    for i in range(closed.shape[0]):
        _write_shapes(rows, closed[i, 0], closed[i, 1], duct.modes, shapes[i])
        for coordinate in range(levers.shape[1]):
            shapes[i, n_modes + coordinate] = levers[i, coordinate]
        for shape in range(excess.shape[0]):
            lasting.moved[shape] = excess[shape] * shapes[i, shape]
        for j in range(i + 1):
            out[i, j] += _sum_of_products(lasting.moved, shapes[j])


@kernel
def _write_shapes(rows: ContactRows, row: int, axis: int, modes: FloatArray, out: Float32Array) -> None:
    """Write the modes' shapes along an axis of a row, zeros if the row does not touch the wall."""
    n_modes = modes.shape[1]
    if not _touches_wall(rows, row):
        for mode in range(n_modes):
            out[mode] = 0.0
        return
    x, y, z = rows.frame[row, axis, 0], rows.frame[row, axis, 1], rows.frame[row, axis, 2]
    for mode in range(n_modes):
        out[mode] = x * modes[3 * row, mode] + y * modes[3 * row + 1, mode] + z * modes[3 * row + 2, mode]


@summing_kernel
def _sum_of_products(a: Float32Array, b: Float32Array) -> float:
    """Return the scalar product of two arrays, summed in their precision."""
    total = np.float32(0.0)
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return float(total)


@kernel
def _touches_wall(rows: ContactRows, row: int) -> bool:
    weight = rows.duct_weight[row]
    return bool(weight[0] != 0.0 or weight[1] != 0.0 or weight[2] != 0.0)


@inlined_kernel
def add_catheter_compliance(
    rows: ContactRows, closed: IntArray, rod: RodAddresses, lasting: LastingArrays, is_factored: bool, out: FloatArray
) -> bool:
    """Add the catheter's compliance beyond that of one step to ``out`` (k, k), the compliance of closed axes (k, 2).

    Only the lower triangle is written. ``is_factored`` is whether the matrix for `LASTING_S` is factorised. Return True
    if it is factorised now: then the factors for the step are overwritten.
    """
    touch, slot = touch_at(rod[0]), lasting.slot
    count = _list_particles(rows, closed, slot, lasting.particles) if rod[3] else 0
    if count == 0:
        return is_factored
    excess = lasting.compliance[: 9 * count * count].reshape(3 * count, 3 * count)
    excess[:] = 0.0
    if not is_factored:
        lasting.is_definite = factor_for_contacts(rod[1:3], LASTING_S)
    if lasting.is_definite:
        band = work_at(rod[2]).band
        compliance(rod[1], band, LASTING_S**2, touch.columns, lasting.particles[:count], excess)
        _subtract_step(touch, lasting.particles[:count], excess)
    for i in range(closed.shape[0]):
        row, axis = closed[i, 0], closed[i, 1]
        if _move_particles(rows, row, axis, slot, excess, lasting.along):
            for j in range(i + 1):
                out[i, j] += _moved_along(rows, closed[j, 0], closed[j, 1], slot, lasting.along)
    return True


@inlined_kernel
def _list_particles(rows: ContactRows, closed: IntArray, slot: IntArray, out: IntArray) -> int:
    """List the particles that closed axes act on, ascending, with the place of each in ``slot``; return their number.

    Other touched ones, as those in the introducer, need not be solved for.
    """
    slot[:] = -1
    for i in range(closed.shape[0]):
        for point in range(rows.rod_node.shape[1]):
            if rows.rod_weight[closed[i, 0], point] != 0.0:
                slot[rows.rod_node[closed[i, 0], point]] = 0
    count = 0
    for particle in range(slot.shape[0]):
        if slot[particle] == 0:
            slot[particle], out[count] = count, particle
            count += 1
    return count


@inlined_kernel
def _subtract_step(touch: CatheterTouch, particles: IntArray, out: FloatArray) -> None:
    """Subtract the compliance of one step between these particles from ``out`` (3 k, 3 k)."""
    stride = 3 * (touch.slot.max() + 1)
    for a in range(particles.shape[0]):
        for b in range(particles.shape[0]):
            first, second = 3 * touch.slot[particles[a]], 3 * touch.slot[particles[b]]
            for i in range(3):
                for j in range(3):
                    out[3 * a + i, 3 * b + j] -= touch.compliance[stride * (first + i) + second + j]


@kernel
def _move_particles(
    rows: ContactRows, row: int, axis: int, slot: IntArray, between: FloatArray, out: FloatArray
) -> bool:
    """Write the motion (3 p,) of the particles under a unit force along an axis; return False if it acts on none."""
    acts, out[: between.shape[0]] = False, 0.0
    for point in range(rows.rod_node.shape[1]):
        weight = rows.rod_weight[row, point]
        if weight != 0.0:
            acts = True
            for k in range(3):
                force, at = weight * rows.frame[row, axis, k], 3 * slot[rows.rod_node[row, point]] + k
                for column in range(between.shape[0]):
                    out[column] += force * between[at, column]
    return acts


@kernel
def _moved_along(rows: ContactRows, row: int, axis: int, slot: IntArray, moved: FloatArray) -> float:
    """Return the motion of a row's contact point along one of its axes, from what `_move_particles` has written."""
    total = 0.0
    for point in range(rows.rod_node.shape[1]):
        weight = rows.rod_weight[row, point]
        if weight != 0.0:
            for k in range(3):
                at = 3 * slot[rows.rod_node[row, point]] + k
                total += weight * rows.frame[row, axis, k] * moved[at]
    return total
