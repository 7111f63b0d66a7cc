"""Contact rows: the points of each contact on duct, catheter and tools, its gap and slip, its law and its force."""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader

N_ROD_POINTS = 4  # two particles on each side, for the catheter touching itself
NO_STONE = -1


class ContactRows(Struct):
    """Preallocated struct of arrays of the contacts and holds of one step; the first ``n_contacts`` are valid.

    Rows are made by `writer.append_row` only.

    Attributes:
        law: (C,) int8. Number in the table of contact laws.
        identity: (C,) int64. Name of the pair of bodies, for the warm start; see `identity`.
        frame: (C, 3, 3) float64. Rows: normal (towards the first body) and two tangents.
        point_m: (C, 3) float64. Point of the first body on which the force acts.
        gap_m: (C,) float64. Distance of the surfaces at the start of the step.
        rest_offset_m: (C,) float64. Overlap of the surfaces up to which there is no force.
        effective_gap_m: (C,) float64. Gap that the laws constrain in this step: the distance, or, where surfaces
            overlap, only the part that is recovered (negative).
        slip_m: (C, 3) float64. Motion of the first body relative to the target over the step without contact forces, in
            world axes.
        elastic_m: (C, 3) float64. Elastic slip at the start of the step, in world axes, for laws with elastic axes; see
            `warm_start.store_anchors`.
        friction_energy_j: (C,) float64. Elastic energy of its friction at the start of the step, in J.
        friction: (C,) float64. Coefficient of Coulomb friction, for laws that have it.
        tresca_bound_n: (C,) float64. Bound on friction independent of the normal force, for laws with friction: zero
            except within a solve.
        force_limit_n: (C,) float64. Largest force, for laws that have one.
        softness_m_n: (C, 3) float64. Compliance of the surfaces in contact, along the rows of the frame.
        force_n: (C, 3) float64. Solved force on the first body, along the rows of the frame.
        duct_node: (C, 3) int32, duct_weight: (C, 3) float64. Barycentric point of the duct, which is always the target;
            weights are zero if the duct is not involved.
        rod_node: (C, 4) int32, rod_weight: (C, 4) float64. Particles of the catheter; weights are positive if it is the
            first body, and negative if it is the target.
        stone: (C,) int8. The gallstone that is the first body, or `NO_STONE`.
        tool: (C,) int8, lever: (C, 3, 4) float64. The tool that is the first body, or `NO_TOOL`, and the derivative of
            the point by the tool's coordinates (m, rad).
        n_contacts: int. Contacts and holds in use.
        dropped: int. Rows that exceeded the capacity since the start.
        dt_s: float. Length of the step, for laws that depend on speeds.
        reserved: int. Rows reserved for holds, which come last: a hold without a row would stretch without a force.
    """

    law: Annotated[ByteArray, "c"]
    identity: Annotated[LongArray, "c"]
    frame: Annotated[FloatArray, "c", 3, 3]
    point_m: Annotated[FloatArray, "c", 3]
    gap_m: Annotated[FloatArray, "c"]
    rest_offset_m: Annotated[FloatArray, "c"]
    effective_gap_m: Annotated[FloatArray, "c"]
    slip_m: Annotated[FloatArray, "c", 3]
    elastic_m: Annotated[FloatArray, "c", 3]
    friction_energy_j: Annotated[FloatArray, "c"]
    friction: Annotated[FloatArray, "c"]
    tresca_bound_n: Annotated[FloatArray, "c"]
    force_limit_n: Annotated[FloatArray, "c"]
    softness_m_n: Annotated[FloatArray, "c", 3]
    force_n: Annotated[FloatArray, "c", 3]
    duct_node: Annotated[IntArray, "c", 3]
    duct_weight: Annotated[FloatArray, "c", 3]
    rod_node: Annotated[IntArray, "c", N_ROD_POINTS]
    rod_weight: Annotated[FloatArray, "c", N_ROD_POINTS]
    stone: Annotated[ByteArray, "c"]
    tool: Annotated[ByteArray, "c"]
    lever: Annotated[FloatArray, "c", 3, N_COORDINATES]
    n_contacts: int = 0
    dropped: int = 0
    dt_s: float = 1e-3
    reserved: int = 0

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
def add_rod_motion(address: Address[ContactRows], motion: FloatArray, sign: float) -> None:
    """Add ``sign`` times the catheter's free motion (n, 3) to the slips of its rows."""
    rows = rows_at(address)
    for row in range(rows.n_contacts):
        for point in range(N_ROD_POINTS):
            weight = sign * rows.rod_weight[row, point]
            if weight != 0.0:
                for axis in range(3):
                    rows.slip_m[row, axis] += weight * motion[rows.rod_node[row, point], axis]
