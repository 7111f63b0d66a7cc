r"""Squeezing between the jaws of a tool: a pair of opposite forces on the two jaws resists their closing.

A wall that is pinched shut resists by its compression (`solid_wall`), a held catheter as a stop. The torque at the
handle is the moment of these forces and of the other contacts' forces, and nothing else.

The wall's torque is a convex function of the opening. A step linearises it: by the chord from the present opening to
the one at which the wall alone would hold the jaws, or by the tangent if the jaws open. On both lines the jaws gain no
more energy than the wall releases, so a step is passive, whatever its length and whatever else pushes the jaws.

The jaws are divided into cells along their length. A cell becomes occupied when wall in it is pressed from both sides,
with no more thickness than fits between the jaws, and is released gradually. So a cell never gains wall that no work
has compressed. A jaw comes nearer to the middle surface of its layer as the layer gets thinner, and that middle surface
moves half as far as the jaws open. So part of a row's force opens the jaws, and the rest acts on the other layer.
How many layers there are is counted along the line between the jaws in each cell (`layers`). What slides out from
between them leaves its room to the others gradually.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, BoolArray, FloatArray, IntArray
from trocar.services.mechanics.bodies.forceps.kinematics import N_CELLS
from trocar.services.mechanics.bodies.forceps.solid_wall import (
    SolidWall,
    cell_m,
    equilibrium_opening,
    jaw_gap_m,
    stored_energy_j,
    wall_reaction,
    write_indentation,
)
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, JAW_A, JAW_B
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import Vector, along, cross, dot, put_row, row_of, subtract, write_frame
from trocar.services.mechanics.compiled.vectors import row as row_at
from trocar.services.mechanics.contact.candidate_search import CandidateSearch
from trocar.services.mechanics.contact.geometry import WallGeometry
from trocar.services.mechanics.contact.identity import SEGMENT, TARGET, TARGET_KIND, pair_identity, part_of, with_law
from trocar.services.mechanics.contact.laws import HAS_GAP, number_of
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.state import ContactState, state_at
from trocar.services.mechanics.contact.system import ContactSystem
from trocar.services.mechanics.contact.writer import NO_ROOM, append_row
from trocar.services.mechanics.scene import DuctScene
from trocar.services.mechanics.scene.tools import N_TOOLS

_SQUEEZE, _GRIP = number_of("squeeze"), number_of("grip")
# Time in which a cell is released once its wall is no longer pressed.
RELEASE_S = 0.05
# A cell becomes occupied only if the jaws leave at least this fraction of the thickness of two layers.
MIN_GAP_SHARE = 0.2
# The chord is used only if the jaws would close by more than this.
_SMALL_RAD = 1e-9


class SqueezeArrays(Struct):
    """Squeezed wall and catheter of both tools, and their rows in this step; axes of length 2 are kinds of target."""

    wall: SolidWall
    row: Annotated[IntArray, N_TOOLS, 2]  # first of a pair, or `NO_ROOM`
    start_rad: Annotated[FloatArray, N_TOOLS]
    stored_j: Annotated[FloatArray, N_TOOLS, 2]
    pressed_span: Annotated[FloatArray, 2, 2, 2]  # scratch: side of the surface, jaw, first and last pressed place (m)
    squeezes: Annotated[BoolArray, N_TOOLS]  # whether a tool squeezes wall
    counted: Annotated[FloatArray, N_TOOLS, N_CELLS]  # scratch: layers between the jaws
    dissipated_j: float = 0.0  # by steps and released cells since the start
    first: int = 0
    count: int = 0


squeeze_at = reader(SqueezeArrays)


class JawSqueeze:
    """The wall and the catheter that the jaws of both tools squeeze.

    Attributes:
        arrays: SqueezeArrays. What is squeezed, and what that has dissipated.
        occupied: (2, N_CELLS) float64. Share of each cell along the jaws that both layers of the wall fill, 0 to 1.
    """

    def __init__(self, duct: DuctScene, system: ContactSystem) -> None:
        self._system, tools = system, system.geometry.tools
        wall = SolidWall.zeros(length_m=tools.jaw_length, radius_m=tools.jaw_radius)
        wall.thickness_m = 2.0 * duct.thickness_m
        wall.modulus_pa = duct.youngs_modulus_pa / (1.0 - duct.poisson_ratio**2)
        self.arrays = SqueezeArrays.zeros(wall=wall)
        self.arrays.row[:] = NO_ROOM
        self.occupied = wall.occupied
        self._layers = self.arrays.counted, wall.layers

    @property
    def rows(self) -> range:
        """Rows of this step, in pairs: a force on jaw A, and its reaction on jaw B."""
        return range(self.arrays.first, self.arrays.first + self.arrays.count)

    @property
    def stored_j(self) -> float:
        """Energy that the squeezed wall and catheter store, in J."""
        return float(self.arrays.stored_j.sum())

    def step_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that a step changes before it is accepted."""
        return self.arrays.own_memory()

    def forget(self) -> None:
        """Release all cells and the catheter, and clear their stored energy."""
        arrays = self.arrays
        arrays.wall.occupied[:] = arrays.wall.layers[:] = arrays.stored_j[:] = 0.0
        arrays.row[:] = NO_ROOM
        arrays.put_zero("first", "count")

    def append_rows(self) -> None:
        """Append the rows of the walls and catheters that the jaws may squeeze in this step."""
        append_squeeze_rows(self._system.address, self.arrays.address)

    def update(self, dt_s: float, search: CandidateSearch) -> None:
        """Update the energies after the jaws have moved, occupy and release cells, and count the layers in them."""
        if update_squeezes(self._system.address, self.arrays.address, dt_s):
            search.count_layers(self._system, self.arrays.squeezes, self._layers, dt_s / RELEASE_S)

    def compile_kernels(self, search: CandidateSearch) -> None:
        """Compile the kernel that only squeezing jaws need."""
        search.count_layers(self._system, np.zeros(N_TOOLS, np.bool_), self._layers, 0.0)

    def write_reactions(self) -> None:
        """Write the forces on jaws B, after the solve has found those on jaws A."""
        write_reactions(self._system.address, self.arrays.address)


@kernel
def append_squeeze_rows(state_address: Address[ContactState], squeeze_address: Address[SqueezeArrays]) -> None:
    """Append a pair of rows for each tool's wall, and one for its catheter, if the jaws may squeeze it in this step."""
    state, squeeze = state_at(state_address), squeeze_at(squeeze_address)
    rows, tools = state.rows, state.geometry.tools
    squeeze.first = rows.n_contacts
    for tool in range(tools.present.shape[0]):
        squeeze.row[tool, DUCT_TRIANGLE] = squeeze.row[tool, CATHETER_SEGMENT] = NO_ROOM
        squeeze.start_rad[tool] = tools.proxy[tool, 3]
        indentation, slope = tools.indentation[tool], tools.indentation_slope[tool]
        write_indentation(squeeze.wall, tool, tools.proxy[tool, 3], indentation, slope)
        tools.layers[tool] = squeeze.wall.layers[tool]
        if tools.present[tool]:
            _append_catheter(rows, tools, squeeze, tool)
            _append_wall(rows, tools, squeeze, tool)
    squeeze.count = rows.n_contacts - squeeze.first


@inlined_kernel
def _append_catheter(rows: ContactRows, tools: ToolArrays, squeeze: SqueezeArrays, tool: int) -> None:
    stop = tools.jaw_stop[tool]
    if tools.free[tool, 3] < stop:
        _append_pair(rows, tools, squeeze, tool, (CATHETER_SEGMENT, tools.stop_arm[tool], stop, math.inf))


@inlined_kernel
def _append_wall(rows: ContactRows, tools: ToolArrays, squeeze: SqueezeArrays, tool: int) -> None:
    wall, start, free = squeeze.wall, tools.proxy[tool, 3], tools.free[tool, 3]
    torque, stiffness, _ = wall_reaction(wall, tool, start)
    if not torque < math.inf or (torque == 0.0 and wall_reaction(wall, tool, free)[0] == 0.0):
        return
    end = equilibrium_opening(wall, tool, free, tools.compliance[tool, 3])
    place = start
    if end < start - _SMALL_RAD:
        stiffness, place = (wall_reaction(wall, tool, end)[0] - torque) / (start - end), end
    if not stiffness > 0.0:
        return
    at_place, _, force = wall_reaction(wall, tool, place)
    arm = at_place / force / math.cos(0.5 * place)
    _append_pair(rows, tools, squeeze, tool, (DUCT_TRIANGLE, arm, start + torque / stiffness, stiffness))


@kernel
def _lever_m(rows: ContactRows, row: int) -> float:
    """Return the lever (m) of a row: the opening distance there per radian of opening."""
    lever, normal = rows.lever[row], rows.frame[row, 0]
    return float(normal[0] * lever[0, 3] + normal[1] * lever[1, 3] + normal[2] * lever[2, 3])


@kernel
def _append_pair(
    rows: ContactRows, tools: ToolArrays, squeeze: SqueezeArrays, tool: int, spring: tuple[int, float, float, float]
) -> None:
    """Append the row of a force on jaw A and that of its reaction on jaw B, if there is room.

    ``spring`` is (target kind, distance along the jaws in m, opening in rad at which the spring is unloaded, its
    stiffness in N m/rad, infinite for a stop).
    """
    kind, arm, opening, stiffness = spring
    if rows.n_contacts + 2 > rows.gap_m.shape[0]:
        rows.dropped += 2
        return
    half, first = 0.5 * tools.proxy[tool, 3], rows.n_contacts
    lever, gap = arm * math.cos(half), arm * math.sin(half) - tools.jaw_radius[tool]
    outwards = row_of(tools.frame, tool, 0)
    middle = along(row_at(tools.proxy, tool), row_of(tools.frame, tool, 2), lever)
    for side in range(2):
        segment, law = (JAW_A, _SQUEEZE) if side == 0 else (JAW_B, _GRIP)
        row = append_row(rows, law, with_law(pair_identity(tool, segment, -1, kind, 0), _SQUEEZE))
        rows.tool[row], rows.lever[row] = tool, 0.0
        write_frame(tools.frame[tool, 0], rows.frame[row])
        put_row(rows.point_m, row, along(middle, outwards, gap if side == 0 else -gap))
    for axis in range(3):
        # Jaw A carries the full lever of the opening; the reaction row takes no part in the solve.
        rows.lever[first, axis, 3] = lever * outwards[axis]
        rows.slip_m[first, axis] = lever * (tools.free[tool, 3] - opening) * outwards[axis]
    rows.force_limit_n[first + 1] = 0.0
    squeeze.row[tool, kind] = first
    lever = _lever_m(rows, first)
    if stiffness < math.inf:
        rows.softness_m_n[first, 0] = lever * lever / stiffness
    for axis in range(1, 3):  # the sum of the squeezed body's and the coupling's compliance, where penalty reads it
        rows.softness_m_n[first, axis] = rows.softness_m_n[first, 0] + lever * lever * tools.compliance[tool, 3]


@kernel
def write_reactions(state_address: Address[ContactState], squeeze_address: Address[SqueezeArrays]) -> None:
    """Write the opposite of the force on jaw A into the row of jaw B, for all pairs."""
    state, squeeze = state_at(state_address), squeeze_at(squeeze_address)
    for row in range(squeeze.first, squeeze.first + squeeze.count, 2):
        for axis in range(3):
            state.rows.force_n[row + 1, axis] = -state.rows.force_n[row, axis]
            state.force_n[row + 1, axis] = -state.force_n[row, axis]


@kernel
def update_squeezes(state_address: Address[ContactState], squeeze_address: Address[SqueezeArrays], dt_s: float) -> bool:
    """Update the energies of the step, and occupy and release cells according to the contacts that were pressed.

    A tool that squeezes nothing has no layers in its jaws. Return whether one squeezes wall.
    """
    state, squeeze, any_squeezes = state_at(state_address), squeeze_at(squeeze_address), False
    rows, tools = state.rows, state.geometry.tools
    for tool in range(tools.present.shape[0]):
        opening, stored_j = tools.proxy[tool, 3], squeeze.stored_j[tool]
        before = stored_j[DUCT_TRIANGLE] + stored_j[CATHETER_SEGMENT]
        stored_j[CATHETER_SEGMENT] = 0.0
        for kind in range(2):
            row = squeeze.row[tool, kind]
            if row != NO_ROOM:
                force = rows.force_n[row, 0]
                squeeze.dissipated_j += force * _lever_m(rows, row) * (squeeze.start_rad[tool] - opening)
                if kind == CATHETER_SEGMENT:
                    stored_j[kind] = 0.5 * rows.softness_m_n[row, 0] * force * force
        if tools.present[tool] and not tools.disengaged[tool]:
            _find_pressed_spans(rows, state.geometry.wall, tools, squeeze.pressed_span, tool)
            _update_cells(squeeze, tool, opening, dt_s)
        else:
            squeeze.wall.occupied[tool] = 0.0
        squeezes = squeeze.wall.occupied[tool].max() > 0.0
        squeeze.squeezes[tool], any_squeezes = squeezes, any_squeezes or squeezes
        if not squeezes:
            squeeze.wall.layers[tool] = 0.0
        stored_j[DUCT_TRIANGLE] = stored_energy_j(squeeze.wall, tool, opening)
        squeeze.dissipated_j += before - stored_j[DUCT_TRIANGLE] - stored_j[CATHETER_SEGMENT]
    return bool(any_squeezes)


@inlined_kernel
def _find_pressed_spans(
    rows: ContactRows, wall: WallGeometry, tools: ToolArrays, pressed_span: FloatArray, tool: int
) -> None:
    """Write the span along each jaw over which it presses wall between the jaws, for each side of the surface."""
    pressed_span[:, :, 0], pressed_span[:, :, 1] = math.inf, -math.inf
    cosine = math.cos(0.5 * tools.proxy[tool, 3])
    for row in range(rows.n_contacts):
        if rows.tool[row] != tool or not HAS_GAP[rows.law[row]] or rows.force_n[row, 0] <= 0.0:
            continue
        segment = part_of(rows.identity[row], SEGMENT)
        is_wall = part_of(rows.identity[row], TARGET_KIND) == DUCT_TRIANGLE
        if not is_wall or segment not in (JAW_A, JAW_B) or _lever_m(rows, row) <= 0.0:
            continue
        jaw = 0 if segment == JAW_A else 1
        side = 1 if _points_outwards(wall, part_of(rows.identity[row], TARGET), row_of(rows.frame, row, 0)) else 0
        arm = subtract(row_at(rows.point_m, row), row_at(tools.proxy, tool))
        place = dot(arm, row_of(tools.frame, tool, 2)) / cosine
        pressed_span[side, jaw, 0] = min(pressed_span[side, jaw, 0], place)
        pressed_span[side, jaw, 1] = max(pressed_span[side, jaw, 1], place)


@inlined_kernel
def _points_outwards(wall: WallGeometry, triangle: int, normal: Vector) -> bool:
    """Return whether a normal points to the same side of the wall as the triangle's normal at rest."""
    corners, rest = wall.triangles[triangle], wall.vertices
    start = row_at(rest, corners[0])
    outwards = cross(subtract(row_at(rest, corners[1]), start), subtract(row_at(rest, corners[2]), start))
    return bool(dot(normal, outwards) > 0.0)


@inlined_kernel
def _update_cells(squeeze: SqueezeArrays, tool: int, opening_rad: float, dt_s: float) -> None:
    """Occupy cells in which both jaws press wall, at its present thickness, and release cells without pressed wall."""
    wall, pressed_span = squeeze.wall, squeeze.pressed_span
    half_cell_m = 0.5 * wall.length_m[tool] / N_CELLS
    for cell in range(N_CELLS):
        place = cell_m(wall, tool, cell)
        is_between = is_touched = False
        for side in range(2):
            first, last = pressed_span[side, :, 0], pressed_span[side, :, 1]
            is_between |= max(first[0], first[1]) - half_cell_m <= place <= min(last[0], last[1]) + half_cell_m
            for jaw in range(2):
                is_touched |= first[jaw] - half_cell_m <= place <= last[jaw] + half_cell_m
        gap = jaw_gap_m(wall, tool, cell, opening_rad)
        is_free = wall.occupied[tool, cell] == 0.0 or gap >= wall.free_m[tool, cell]
        if is_between and is_free and gap >= MIN_GAP_SHARE * wall.thickness_m:
            wall.occupied[tool, cell], wall.free_m[tool, cell] = 1.0, min(gap, wall.thickness_m)
        elif not is_touched:
            wall.occupied[tool, cell] = max(wall.occupied[tool, cell] - dt_s / RELEASE_S, 0.0)
