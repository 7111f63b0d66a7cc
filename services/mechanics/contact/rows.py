"""Contact rows: the points of each contact on duct, catheter and tools, its gap and slip, its law and its force."""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from trocar.services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct, reader
from trocar.services.mechanics.compiled.vectors import Vector, combine, dot, row_of
from trocar.services.mechanics.contact.identity import TARGET_KIND, part_of
from trocar.services.mechanics.scene.tools import N_TOOLS

N_ROD_POINTS = 4  # two particles on each side, for the catheter touching itself
NO_STONE, MAX_STONES = -1, 127  # a byte tells so many apart
N_BODIES = 1 + N_TOOLS + MAX_STONES  # the catheter, tools and stones
# In `ContactRows.pressure_n`: friction is bounded by the present normal force; it keeps its present value, which the
# pressure that is subtracted from this number bounded.
PRESENT, KEPT = -1.0, -2.0


class ContactRows(Struct):
    """Contacts and holds of one step, of which the first ``n_contacts`` are valid; `writer.append_row` makes them.

    The first body is a tool, the catheter or a gallstone, the target is the duct or the catheter. A node or particle of
    weight zero is not touched. Weights of particles are positive on the first body's side, negative on the target's.
    """

    law: Annotated[ByteArray, "c"]  # number in the table of contact laws
    identity: Annotated[LongArray, "c"]  # name of the pair of bodies, for the warm start, see `identity`
    frame: Annotated[FloatArray, "c", 3, 3]  # normal, towards the first body, and two tangents
    point_m: Annotated[FloatArray, "c", 3]  # of the first body, on which the force acts
    gap_m: Annotated[FloatArray, "c"]  # distance of the surfaces at the start of the step
    rest_offset_m: Annotated[FloatArray, "c"]  # overlap up to which there is no force
    correction_m: Annotated[FloatArray, "c"]  # what the step ends deeper than linear motion predicts, see `price`
    sunk_m: Annotated[FloatArray, "c"]  # how far its force has pressed the surfaces into each other, see `free_motion`
    effective_gap_m: Annotated[FloatArray, "c"]  # that the laws constrain: the gap, or the recovered part of an overlap
    slip_m: Annotated[FloatArray, "c", 3]  # relative motion over the step without contact forces, along world axes
    elastic_m: Annotated[FloatArray, "c", 3]  # elastic slip at its start, along world axes, see `store_anchors`
    slid_m: Annotated[FloatArray, "c"]  # how far the surfaces have slid before, see `sliding`; negative if not known
    friction_energy_j: Annotated[FloatArray, "c"]  # elastic energy of friction at the start of the step
    friction: Annotated[FloatArray, "c"]  # Coulomb's coefficient, for laws that have it
    pressure_n: Annotated[FloatArray, "c"]  # that bounds friction, or `PRESENT` or `KEPT`, see `solver`
    force_limit_n: Annotated[FloatArray, "c"]  # largest force, for laws that have one
    softness_m_n: Annotated[FloatArray, "c", 3]  # compliance of the surfaces, along the frame
    force_n: Annotated[FloatArray, "c", 3]  # solved force on the first body, along the frame
    duct_node: Annotated[IntArray, "c", 3]
    duct_weight: Annotated[FloatArray, "c", 3]  # barycentric
    rod_node: Annotated[IntArray, "c", N_ROD_POINTS]
    rod_weight: Annotated[FloatArray, "c", N_ROD_POINTS]
    stone: Annotated[ByteArray, "c"]  # or `NO_STONE`
    tool: Annotated[ByteArray, "c"]  # or `NO_TOOL`
    lever: Annotated[FloatArray, "c", 3, N_COORDINATES]  # derivative of the point by the tool's coordinates, in m, rad
    n_contacts: int = 0
    dropped: int = 0  # rows that exceeded the capacity since the start
    dt_s: float = 1e-3  # length of the step, for laws that depend on speeds
    relaxed: float = 0.0  # share of an overlap that the step takes back
    reserved: int = 0  # rows for holds, which come last: a hold without a row would stretch without a force

    @property
    def capacity(self) -> int:
        """Maximum number of contacts."""
        return len(self.gap_m)

    @property
    def has_room(self) -> bool:
        """Whether another contact can be appended."""
        return self.n_contacts + self.reserved < self.capacity

    @property
    def on_duct(self) -> tuple[IntArray, FloatArray]:
        """Nodes and weights (k, 3) of the contacts in use."""
        return self.duct_node[: self.n_contacts], self.duct_weight[: self.n_contacts]

    @property
    def on_rod(self) -> tuple[IntArray, FloatArray]:
        """Particles and weights (k, 4) of the contacts in use."""
        return self.rod_node[: self.n_contacts], self.rod_weight[: self.n_contacts]


rows_at = reader(ContactRows)


@kernel
def pair_of_bodies(rows: ContactRows, row: int) -> int:
    """Return the number, below ``2 N_BODIES``, of a row's two bodies: that of the first, and the kind of target."""
    first = rows.tool[row] + 1 if rows.stone[row] == NO_STONE else N_TOOLS + 1 + rows.stone[row]
    return int(2 * first + part_of(rows.identity[row], TARGET_KIND))


@kernel
def in_frame(rows: ContactRows, row: int, vector: Vector) -> Vector:
    """Return a vector's components along the axes of a row's frame."""
    frame = rows.frame
    return dot(row_of(frame, row, 0), vector), dot(row_of(frame, row, 1), vector), dot(row_of(frame, row, 2), vector)


@kernel
def in_world(rows: ContactRows, row: int, vector: Vector) -> Vector:
    """Return a vector along world axes, from its components along the axes of a row's frame."""
    frame = rows.frame
    return combine(vector, row_of(frame, row, 0), row_of(frame, row, 1), row_of(frame, row, 2))
