"""Contact rows: where each contact acts on duct, catheter and tools, and how far apart the surfaces are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from services.mechanics.collision.pairs import NO_TOOL
from services.mechanics.compiled import tuple_reader, tuple_table

N_ROD_POINTS = 4  # two particles on each side, for the catheter touching itself
NO_STONE = -1


class ContactRows(NamedTuple):
    """Preallocated struct of arrays of the contacts and holds of one step; ``used[0]`` of them mean anything.

    A named tuple, so that kernels hand it on as one argument; those that Python calls find it at its address. Rows
    are made by `writer.append_row` only.

    Attributes
    ----------
    used : (1,) int64
    dropped : (1,) int64
        Rows that found no room since the start.
    law : (C,) int8
        Number in the table of contact laws.
    identity : (C,) int64
        Names the pair of bodies, to find last tick's force again; see `identity`.
    frame : (C, 3, 3) float64
        Rows: normal (towards the first body) and two tangents.
    point_m : (C, 3) float64
        Where the force acts on the first body.
    gap_m : (C,) float64
        Distance of the surfaces at the start of the step.
    slip_m : (C, 3) float64
        Motion of the first body relative to the target over the step without contact forces, in world axes.
    friction : (C,) float64
        Coefficient of Coulomb friction, for laws that have it.
    force_limit_n : (C,) float64
        Largest force, for laws that have one.
    softness_m_n : (C, 3) float64
        Compliance of the touching surfaces themselves, along the rows of the frame.
    force_n : (C, 3) float64
        Solved force on the first body, along the rows of the frame.
    duct_node : (C, 3) int32, duct_weight : (C, 3) float64
        Barycentric point of the duct, always the target; weights are zero where the duct has no part.
    rod_node : (C, 4) int32, rod_weight : (C, 4) float64
        Particles of the catheter; positive weights where it is the first body, negative where it is the target.
    stone : (C,) int8
        The gallstone that is the first body, `NO_STONE` where none is.
    tool : (C,) int8, lever : (C, 3, 4) float64
        The tool that is the first body, and how its coordinates move the point.
    table : LongArray, address : int
        What `rows_at` reads at ``address``.
    """

    used: LongArray
    dropped: LongArray
    law: ByteArray
    identity: LongArray
    frame: FloatArray
    point_m: FloatArray
    gap_m: FloatArray
    slip_m: FloatArray
    friction: FloatArray
    force_limit_n: FloatArray
    softness_m_n: FloatArray
    force_n: FloatArray
    duct_node: IntArray
    duct_weight: FloatArray
    rod_node: IntArray
    rod_weight: FloatArray
    stone: ByteArray
    tool: ByteArray
    lever: FloatArray
    table: LongArray
    address: int

    @classmethod
    def allocate(cls, capacity: int) -> ContactRows:
        """Return room for ``capacity`` contacts and holds."""
        rows = cls(
            used=np.zeros(1, np.int64),
            dropped=np.zeros(1, np.int64),
            law=np.zeros(capacity, np.int8),
            identity=np.zeros(capacity, np.int64),
            frame=np.zeros((capacity, 3, 3)),
            point_m=np.zeros((capacity, 3)),
            gap_m=np.zeros(capacity),
            slip_m=np.zeros((capacity, 3)),
            friction=np.zeros(capacity),
            force_limit_n=np.zeros(capacity),
            softness_m_n=np.zeros((capacity, 3)),
            force_n=np.zeros((capacity, 3)),
            duct_node=np.zeros((capacity, 3), np.int32),
            duct_weight=np.zeros((capacity, 3)),
            rod_node=np.zeros((capacity, N_ROD_POINTS), np.int32),
            rod_weight=np.zeros((capacity, N_ROD_POINTS)),
            stone=np.full(capacity, NO_STONE, np.int8),
            tool=np.full(capacity, NO_TOOL, np.int8),
            lever=np.zeros((capacity, 3, N_COORDINATES)),
            table=np.zeros(0, np.int64),
            address=0,
        )
        table = tuple_table(rows)
        return rows._replace(table=table, address=table.ctypes.data)

    @property
    def capacity(self) -> int:
        """Number of contacts there is room for."""
        return int(self.gap_m.shape[0])

    @property
    def n_contacts(self) -> int:
        """Number of contacts and holds in use."""
        return int(self.used[0])


rows_at = tuple_reader(ContactRows.allocate(1))
