"""The local stiffness between each hand and the world, which a servo uses until the next solve."""

from __future__ import annotations

import math
from typing import Annotated, cast

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from services.mechanics.bodies.forceps.tool_body import ToolArrays, tools_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.contact.admissible import closed_axes
from services.mechanics.contact.geometry import Bodies
from services.mechanics.contact.lasting_compliance import (
    LastingArrays,
    RodPlaces,
    WallPlaces,
    add_of_catheter,
    add_of_wall,
    lasting_at,
)
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.rod.model import RodModel, RodWork
from services.mechanics.scene.tools import N_TOOLS, ToolResults

NO_ROD = cast(tuple[Address[RodModel], Address[RodWork]], (0, 0))
MOST_CLOSED = 72  # axes of the contacts of one tool that enter its local stiffness


class StiffnessArrays(Struct):
    """The stiffnesses of `ToolResults`, and work space."""

    stiffness: Annotated[FloatArray, N_TOOLS, 3, 3]
    grasp_stiffness: Annotated[FloatArray, N_TOOLS]
    closed: Annotated[IntArray, MOST_CLOSED, 2]  # rows, and which of their axes
    scratch: Annotated[FloatArray, MOST_CLOSED * (MOST_CLOSED + N_COORDINATES)]

    @classmethod
    def of(cls, results: ToolResults) -> StiffnessArrays:
        """View the arrays of ``results``."""
        return cls.zeros(stiffness=results.stiffness_n_m, grasp_stiffness=results.grasp_stiffness_nm_rad)


stiffness_at = reader(StiffnessArrays)


class LocalStiffness:
    """Writes the stiffnesses of `ToolResults` after a step with these bodies and contacts."""

    def __init__(self, bodies: Bodies, contacts: Address[ContactState], results: ToolResults) -> None:
        duct, catheter, self._rod = bodies.duct, bodies.catheter, bodies.catheter.plain_integrator
        self._arrays = StiffnessArrays.of(results)
        omega, ratio = duct.reduced.basis.omega_rad_s, duct.reduced.damping_ratio
        self._lasting = LastingArrays.of(omega, ratio, catheter.properties.n_particles, MOST_CLOSED)
        rod = NO_ROD if self._rod is None else self._rod.addresses
        places: RodPlaces = (catheter.touch_address, *rod, self._rod is not None)
        arrays = (self._arrays.address, self._lasting.address)
        self._arguments = (contacts, bodies.tools.address, *arrays, duct.loads_address, places)

    def write(self) -> None:
        """Write the stiffnesses; call this once the step is over."""
        if local_stiffness(*self._arguments) and self._rod is not None:
            self._rod.is_factored = False


@kernel
def local_stiffness(
    state_address: Address[ContactState],
    tools_address: Address[ToolArrays],
    out_address: Address[StiffnessArrays],
    lasting_address: Address[LastingArrays],
    wall: WallPlaces,
    rod: RodPlaces,
) -> bool:
    r"""Write the stiffness between each hand and the world: (2, 3, 3) in N/m at J, (2,) in N m/rad of the jaws.

    The rows of a tool that carry force (normals; tangents too while they stick; holds that do not slip) stay
    closed when the hand moves by dx, so their forces change by :math:`-S^{-1} G\,dx` with S their compliance over
    `LASTING_S`, see `lasting_compliance`. S contains the couplings as they act over one step, dampers included; what a
    damper adds is taken out (1/K minus the step's compliance is put in), so that the result is a spring.

    Return True if the catheter's matrix was factorised for another step length: the step's factors are gone.
    """
    state, tools = state_at(state_address), tools_at(tools_address)
    out, lasting = stiffness_at(out_address), lasting_at(lasting_address)
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
        _add_excess(tools, tool, S, G)
        add_of_wall(state.rows, closed, wall, lasting, S)
        is_factored = add_of_catheter(state.rows, closed, rod, lasting, is_factored, S)
        if _whiten(S, G):
            _write(G, out.stiffness[tool])
            for k in range(n):
                out.grasp_stiffness[tool] += G[k, 3] * G[k, 3]
    return is_factored


@kernel
def _write(G: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        for j in range(3):
            for k in range(G.shape[0]):
                out[i, j] += G[k, i] * G[k, j]


@kernel
def _list_closed(rows: ContactRows, slides: BoolArray, tool: int, out: IntArray) -> int:
    """List the axes that stay closed when the tool moves, of as many contacts as there is room for."""
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
    """Fill the compliance S (n, n) and the levers G (n, 4) of the closed axes (n, 2), in the contacts' frames."""
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
def _add_excess(tools: ToolArrays, tool: int, S: FloatArray, G: FloatArray) -> None:
    """Add the compliance of the coupling's spring beyond that of spring and damper in a step, lower half of S."""
    for coordinate in range(G.shape[1]):
        excess = 1.0 / tools.stiffness[tool, coordinate] - tools.compliance[tool, coordinate]
        for i in range(S.shape[0]):
            for j in range(i + 1):
                S[i, j] += excess * G[i, coordinate] * G[j, coordinate]


@kernel
def _whiten(S: FloatArray, G: FloatArray) -> bool:
    """Overwrite G (n, 4) by L^-1 G with S = L L^T (in place, lower half); False where S is not positive."""
    n = S.shape[0]
    for j in range(n):
        pivot = S[j, j]
        for k in range(j):
            pivot -= S[j, k] * S[j, k]
        if not pivot > 0.0:
            return False
        S[j, j] = math.sqrt(pivot)
        for i in range(j + 1, n):
            total = S[i, j]
            for k in range(j):
                total -= S[i, k] * S[j, k]
            S[i, j] = total / S[j, j]
        for coordinate in range(G.shape[1]):
            total = G[j, coordinate]
            for k in range(j):
                total -= S[j, k] * G[k, coordinate]
            G[j, coordinate] = total / S[j, j]
    return True
