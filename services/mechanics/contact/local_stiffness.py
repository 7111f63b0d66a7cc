"""The local stiffness between each hand and the bodies it touches, which a servo uses until the next solve."""

from __future__ import annotations

import math
from typing import Annotated, cast

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.dense import sum_of_products
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.contact.admissible import closed_axes
from trocar.services.mechanics.contact.geometry import Bodies
from trocar.services.mechanics.contact.lasting_compliance import (
    LastingArrays,
    RodAddresses,
    WallAddress,
    add_catheter_compliance,
    add_compliance_of_shapes,
)
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.state import ContactState, state_at
from trocar.services.mechanics.rod.model import RodModel, RodWork
from trocar.services.mechanics.scene.tools import N_TOOLS, ToolResults

NO_ROD = cast(tuple[Address[RodModel], Address[RodWork]], (0, 0))
MAX_CLOSED = 72  # maximum number of contact axes that enter the local stiffness of a tool


class StiffnessArrays(Struct):
    """The stiffnesses of `ToolResults`, and work space."""

    stiffness: Annotated[FloatArray, N_TOOLS, 3, 3]
    grasp_stiffness: Annotated[FloatArray, N_TOOLS]
    lasting: LastingArrays
    closed: Annotated[IntArray, MAX_CLOSED, 2]  # rows, and which of their axes
    scratch: Annotated[FloatArray, MAX_CLOSED * (MAX_CLOSED + N_COORDINATES)]


stiffness_at = reader(StiffnessArrays)


class LocalStiffness:
    """Writes the stiffnesses of `ToolResults` after a step with these bodies and contacts."""

    def __init__(self, bodies: Bodies, contacts: Address[ContactState], results: ToolResults) -> None:
        duct, catheter, self._rod = bodies.duct, bodies.catheter, bodies.catheter.plain_integrator
        omega, ratio = duct.reduced.basis.omega_rad_s, duct.reduced.damping_ratio
        self._arrays = StiffnessArrays.zeros(
            stiffness=results.stiffness_n_m,
            grasp_stiffness=results.grasp_stiffness_nm_rad,
            lasting=LastingArrays.of(omega, ratio, catheter.properties.n_particles, MAX_CLOSED),
        )
        rod = NO_ROD if self._rod is None else self._rod.addresses
        places: RodAddresses = (catheter.touch_address, *rod, self._rod is not None)
        self._arguments = (contacts, self._arrays.address, duct.loads_address, places)

    def write(self) -> None:
        """Write the stiffnesses; call it at the end of a step."""
        if local_stiffness(*self._arguments) and self._rod is not None:
            self._rod.is_factored = False


@kernel
def local_stiffness(
    state_address: Address[ContactState], out_address: Address[StiffnessArrays], wall: WallAddress, rod: RodAddresses
) -> bool:
    r"""Write the stiffness between each hand and what it touches: (2, 3, 3) in N/m at J, (2,) in N m/rad of the jaws.

    Axes that carry force (normals; tangents too while they stick; holds that do not slip) stay closed when the hand
    moves by dx. So their forces change by :math:`-S^{-1} G\,dx`, with G their levers and S their compliance over
    `LASTING_S`, see `lasting_compliance`. The stiffness is :math:`G^T S^{-1} G`. In S the compliance of the couplings
    over one step, which includes their dampers, is replaced by that of their springs, 1/K.

    Return True if the catheter's matrix was factorised for another step length: the factors for the step are then
    overwritten.
    """
    state, out = state_at(state_address), stiffness_at(out_address)
    size = 3 * state.rows.n_contacts
    W = state.delassus[: size * size].reshape(size, size)
    is_factored = False
    for tool in range(out.stiffness.shape[0]):
        out.stiffness[tool] = 0.0
        out.grasp_stiffness[tool] = 0.0
        n = _list_closed(state.rows, state.slides, tool, out.closed)
        if n == 0:
            continue
        closed, S = out.closed[:n], out.scratch[: n * n].reshape(n, n)
        G = out.scratch[n * n : n * (n + N_COORDINATES)].reshape(n, N_COORDINATES)
        _fill_closed(state.rows, W, closed, S, G)
        add_compliance_of_shapes(state.rows, closed, wall, (state.geometry.tools, tool, G), out.lasting, S)
        is_factored = add_catheter_compliance(state.rows, closed, rod, out.lasting, is_factored, S)
        if _whiten(S, G):
            for k in range(n):
                out.grasp_stiffness[tool] += G[k, 3] * G[k, 3]
                for i in range(3):
                    for j in range(3):
                        out.stiffness[tool, i, j] += G[k, i] * G[k, j]
    return is_factored


@kernel
def _list_closed(rows: ContactRows, slides: BoolArray, tool: int, out: IntArray) -> int:
    """Write (row, axis) of the axes that stay closed when the tool moves, up to the capacity of ``out``."""
    count = 0
    for row in range(rows.n_contacts):
        axes = closed_axes(rows, row, slides[row]) if rows.tool[row] == tool else 0
        if count + axes <= out.shape[0]:
            for axis in range(axes):
                out[count, 0], out[count, 1] = row, axis
                count += 1
    return count


@kernel
def _fill_closed(rows: ContactRows, W: FloatArray, closed: IntArray, S: FloatArray, G: FloatArray) -> None:
    """Write the compliance S (n, n), lower triangle, and the levers G (n, 4) of the closed axes (n, 2)."""
    for i in range(closed.shape[0]):
        row, axis = closed[i, 0], closed[i, 1]
        for coordinate in range(G.shape[1]):
            total = 0.0
            for k in range(3):
                total += rows.frame[row, axis, k] * rows.lever[row, k, coordinate]
            G[i, coordinate] = total
        for j in range(i + 1):
            S[i, j] = W[3 * row + axis, 3 * closed[j, 0] + closed[j, 1]]


@kernel
def _whiten(S: FloatArray, G: FloatArray) -> bool:
    """Overwrite G (n, 4) by L^-1 G, with S = L L^T; return False if S is not positive definite.

    L is written over the lower triangle of S, without its diagonal.
    """
    for j in range(S.shape[0]):
        pivot = S[j, j] - sum_of_products(S[j], S[j], j)
        if not pivot > 0.0:
            return False
        inverse = 1.0 / math.sqrt(pivot)
        for i in range(j + 1, S.shape[0]):
            S[i, j] = (S[i, j] - sum_of_products(S[i], S[j], j)) * inverse
        for coordinate in range(G.shape[1]):
            G[j, coordinate] *= inverse
        for i in range(j + 1, S.shape[0]):
            for coordinate in range(G.shape[1]):
                G[i, coordinate] -= S[i, j] * G[j, coordinate]
    return True
