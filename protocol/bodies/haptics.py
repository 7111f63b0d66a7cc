"""What haptics says: a local model of force for the servo, tools and grasps for physics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

import msgspec
from msgspec import Meta

from trocar.protocol.arrays import Array, spec
from trocar.protocol.table import TableRow, columns
from trocar.protocol.vectors import ZERO3, ZERO9, Mat3, Vec3


class LocalModel(TableRow, array_like=True, frozen=True, kw_only=True):
    """Force on one instrument near a state: ``f = f0 - K (x - x0) - B (v - v0)``; the same for the grasp torque.

    A row of `ContactModel.models` by its names, for whoever does not mind an object: servo and haptics take rows.
    """

    force_n: Annotated[Vec3, Meta(description="f0")] = ZERO3
    stiffness_n_m: Annotated[Mat3, Meta(description="K, positive semi-definite")] = ZERO9
    damping_n_s_m: Annotated[Mat3, Meta(description="B, positive semi-definite")] = ZERO9
    reference_position_m: Annotated[Vec3, Meta(description="x0: the HIP that the model was made for")] = ZERO3
    reference_velocity_m_s: Annotated[Vec3, Meta(description="v0")] = ZERO3
    grasp_torque_nm: Annotated[float, Meta(description="torque on the handle at the reference angle")] = 0.0
    grasp_stiffness_nm_rad: Annotated[float, Meta(ge=0.0)] = 0.0
    grasp_damping_nm_s_rad: Annotated[float, Meta(ge=0.0)] = 0.0
    reference_angle_rad: Annotated[float, Meta(description="handle angle that the torque was solved for")] = 0.0
    reference_rate_rad_s: float = 0.0
    in_contact: Annotated[bool, Meta(description="false: free space, every force above is zero")] = False


#: Where the parts of ``f = f0 - K (x - x0) - B (v - v0)`` and of the grasp's torque begin in the table of local models.
(
    MODEL_F0, MODEL_K, MODEL_B, MODEL_X0, MODEL_V0, MODEL_TORQUE, MODEL_GRASP_K, MODEL_GRASP_B, MODEL_ANGLE0,
    MODEL_RATE0, MODEL_CONTACT, MODEL_COLUMNS,
) = columns(LocalModel)  # fmt: skip


class ContactModel(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """A fresh local model per instrument, in the order of the device frame that it answers."""

    tick: Annotated[int, Meta(ge=0, description="tick of the device frame answered")]
    ttl_s: Annotated[float, Meta(gt=0.0, le=0.1, description="force is zero once the model is older than this")]
    models: Annotated[
        Array,
        spec(
            "<f8",
            ("instruments", MODEL_COLUMNS),
            "3 f0 in N; 9 K in N/m and 9 B in N s/m, by rows, positive semi-definite; 3 x0 in m and 3 v0 in m/s, which "
            "the model was made for; grasp: torque on the handle in N m, its stiffness in N m/rad and damping in "
            "N m s/rad, both ge 0, the angle in rad and rate in rad/s that it was solved for; 1 in contact, or 0: free "
            "space, every force is zero",
            row=LocalModel,
        ),
    ]

    @classmethod
    def of(cls, tick: int, ttl_s: float, models: Sequence[LocalModel]) -> Self:
        """Return a frame's body of such models."""
        return cls(tick=tick, ttl_s=ttl_s, models=LocalModel.table(models))

    def local_models(self) -> tuple[LocalModel, ...]:
        """Return the models by their names, of a checked body."""
        return tuple(map(LocalModel.from_row, self.models.view().tolist()))


class ToolState(TableRow, array_like=True, frozen=True, kw_only=True):
    """One forceps as physics needs it: a row of `ToolContacts.tools` by its names."""

    position_m: Annotated[Vec3, Meta(description="HIP: the junction J")]
    port_m: Annotated[Vec3, Meta(description="the trocar's fixed point")] = ZERO3
    roll_rad: Annotated[float, Meta(description="of the jaws about the shaft; pose = J, port and roll")] = 0.0
    jaw_angle_rad: Annotated[float, Meta(description="opening between the jaws that the handle asks for")] = 0.0


TOOL_POSITION, TOOL_PORT, TOOL_ROLL, TOOL_OPENING, TOOL_COLUMNS = columns(ToolState)
tool_table = ToolState.table


class HeldPoint(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """A grasp: the jaws of a tool hold a point of the duct wall or of the catheter."""

    hold_id: Annotated[int, Meta(ge=0, description="a new grasp takes a new number")]
    tool: Annotated[int, Meta(ge=0, lt=8)]
    target_kind: Annotated[int, Meta(ge=0, le=1, description="0 duct triangle, 1 catheter segment")]
    target: Annotated[int, Meta(ge=0, description="triangle or segment index")]
    target_weights: Annotated[Vec3, Meta(description="barycentric; catheter segment: (1-s, s, 0)")]
    limit_n: Annotated[float, Meta(ge=0.0, description="the hold slips above: grip friction times the squeeze")]
    jaw_angle_rad: Annotated[float, Meta(description="opening at which the jaws met what they hold")]


class ToolContacts(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """One row per tool, and what the tools hold; physics itself finds what they touch."""

    tick: Annotated[int, Meta(ge=0, description="tick of the device frame answered: physics' clock")]
    tools: Annotated[
        Array,
        spec(
            "<f8",
            ("tools", TOOL_COLUMNS),
            "3 of the HIP, which is the junction J, in m; 3 of the trocar's fixed point in m; roll of the jaws about "
            "the shaft, and the opening between them that the handle asks for, in rad",
            row=ToolState,
        ),
    ]
    holds: Annotated[tuple[HeldPoint, ...], Meta(max_length=16)] = ()
    begins: Annotated[int, Meta(ge=0, description="of the device frame answered")] = 0
    withdrawn: Annotated[
        int, Meta(ge=0, lt=1 << 8, description="bit mask of tools that touch nothing, of the device frame answered")
    ] = 0

    def tool_states(self) -> tuple[ToolState, ...]:
        """Return the tools by their names, of a checked body."""
        return tuple(map(ToolState.from_row, self.tools.view().tolist()))
