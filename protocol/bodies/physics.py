"""What physics says of a tick, in one frame: what the tools feel, duct, catheter and solved contacts."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from trocar.protocol.arrays import Array, pack, spec
from trocar.protocol.table import TableRow, columns
from trocar.protocol.vectors import ZERO3, ZERO9, Mat3, Vec3


class Duct(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """The duct: modal coordinates and the loads whose residual compliance shapes it near contacts.

    Node i is at ``X_i + Phi_i q + sum_j R_ij f_j`` over the loaded nodes j; `basis_hash` names Phi and R.
    """

    basis_hash: Annotated[str, Meta(max_length=64, description="content hash of the modal basis")]
    q: Annotated[Array, spec("<f8", ("modes",), "m sqrt(kg)")]
    q_rate: Annotated[Array, spec("<f8", ("modes",), "m sqrt(kg)/s")]
    load_node: Annotated[Array, spec("<i4", ("loads",), "index")]
    load_force_n: Annotated[Array, spec("<f8", ("loads", 3), "N")]


class Catheter(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """The catheter's particles along its centreline, tip last."""

    position_m: Annotated[Array, spec("<f8", ("particles", 3), "m")]
    velocity_m_s: Annotated[Array, spec("<f8", ("particles", 3), "m/s")]
    radius_m: Annotated[float, Meta(gt=0.0)]
    inserted_length_m: Annotated[float, Meta(description="arc length inside the lumen")] = 0.0


class ToolReaction(TableRow, array_like=True, frozen=True, kw_only=True):
    """Solved force on one tool, and the stiffness that it meets: a row of `PhysicsState.tools` by its names."""

    force_n: Annotated[Vec3, Meta(description="on the tool, at J")] = ZERO3
    port_moment_nm: Annotated[Vec3, Meta(description="coupling moment about the trocar")] = ZERO3
    grasp_torque_nm: Annotated[float, Meta(description="on the jaws, opens them where positive")] = 0.0
    grasp_stiffness_nm_rad: Annotated[float, Meta(description="local stiffness of the opening, coupling included")] = (
        0.0
    )
    stiffness_n_m: Annotated[Mat3, Meta(description="local stiffness felt at J, virtual coupling included")] = ZERO9
    position_m: Annotated[Vec3, Meta(description="the HIP that the force was solved for")] = ZERO3
    jaw_angle_rad: Annotated[float, Meta(description="opening asked for that the torque was solved for")] = 0.0
    proxy_position_m: Annotated[Vec3, Meta(description="where the tool is held by what it touches")] = ZERO3
    contacts: Annotated[int, Meta(ge=0)] = 0
    holds: Annotated[int, Meta(ge=0, description="grasps in force")] = 0
    proxy_jaw_angle_rad: Annotated[
        float, Meta(description="opening at which what is between the jaws stops them, -1 not known")
    ] = -1.0

    TABLE_ORDER = (
        "force_n", "port_moment_nm", "proxy_position_m", "stiffness_n_m", "grasp_torque_nm", "grasp_stiffness_nm_rad",
        "proxy_jaw_angle_rad", "contacts", "holds", "position_m", "jaw_angle_rad",
    )  # fmt: skip


(
    REACTION_FORCE, REACTION_MOMENT, REACTION_PROXY, REACTION_STIFFNESS, REACTION_GRASP_TORQUE,
    REACTION_GRASP_STIFFNESS, REACTION_PROXY_OPENING, REACTION_CONTACTS, REACTION_HOLDS, REACTION_POSITION,
    REACTION_OPENING, REACTION_COLUMNS,
) = columns(ToolReaction)  # fmt: skip
reaction_table = ToolReaction.table


class ContactForces(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Contact points of one step, and the solved forces."""

    kind: Annotated[Array, spec("|i1", ("contacts",), "0 tool-duct, 1 tool-catheter, 2 catheter-duct, 3 other")]
    point_m: Annotated[Array, spec("<f8", ("contacts", 3), "m")]
    force_n: Annotated[Array, spec("<f8", ("contacts", 3), "N")]
    max_penetration_m: float = 0.0


NO_STONES = pack(np.zeros((0, 3)))


class PhysicsState(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """The result of one step of physics."""

    tick: Annotated[int, Meta(ge=0, description="tick of the device frame answered")]
    tools: Annotated[
        Array,
        spec(
            "<f8",
            ("tools", REACTION_COLUMNS),
            "3 of the force on the tool, at J, in N; 3 of the coupling's moment about the trocar in N m; 3 of where "
            "the tool is held by what it touches in m; 9 of the local stiffness felt at J, by rows, virtual coupling "
            "included, in N/m; torque on the jaws, which opens them where positive, in N m, and the stiffness of the "
            "opening, coupling included, in N m/rad; opening at which what is between the jaws stops them, -1 not "
            "known, in rad; numbers of contacts and of grasps in force; 3 of the HIP in m, and the opening asked for "
            "in rad, that force and torque were solved for",
            row=ToolReaction,
        ),
    ]
    duct: Duct
    catheter: Catheter
    contacts: ContactForces
    ticks_per_step: Annotated[
        int, Meta(ge=1, le=16, description="ticks per step of physics, which reads tools once a step")
    ] = 1
    stones_m: Annotated[Array, spec("<f8", ("stones", 3), "middles of the stones, in the scene's order, in m")] = (
        NO_STONES
    )

    def reactions(self, most: int | None = None) -> tuple[ToolReaction, ...]:
        """Return what the tools, or the first ``most`` of them, feel by its names, of a checked body."""
        return tuple(map(ToolReaction.from_row, self.tools.view()[:most].tolist()))
