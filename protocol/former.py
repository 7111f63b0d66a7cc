"""Bodies as they were in former versions: only what decodes their bytes. `trocar.protocol.upgrades` lifts them."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from trocar.protocol.arrays import Array, pack, spec
from trocar.protocol.bodies.haptics import (
    TOOL_COLUMNS,
    ContactModel,
    HeldPoint,
    LocalModel,
    ToolContacts,
    ToolState,
    tool_table,
)
from trocar.protocol.bodies.physics import Catheter, ContactForces, Duct, PhysicsState, ToolReaction, reaction_table
from trocar.protocol.vectors import ZERO3, ZERO9, Mat3, Vec3


class LocalModel1(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Version 1 carried a moment that no servo uses."""

    force_n: Vec3 = ZERO3
    stiffness_n_m: Mat3 = ZERO9
    damping_n_s_m: Mat3 = ZERO9
    reference_position_m: Vec3 = ZERO3
    reference_velocity_m_s: Vec3 = ZERO3
    grasp_torque_nm: float = 0.0
    grasp_stiffness_nm_rad: Annotated[float, Meta(ge=0.0)] = 0.0
    grasp_damping_nm_s_rad: Annotated[float, Meta(ge=0.0)] = 0.0
    reference_angle_rad: float = 0.0
    reference_rate_rad_s: float = 0.0
    port_moment_nm: Vec3 = ZERO3
    in_contact: bool = False


class ContactModel1(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Version 1 of ``haptics.contact_model``."""

    tick: Annotated[int, Meta(ge=0)]
    ttl_s: Annotated[float, Meta(gt=0.0, le=0.1)]
    instruments: Annotated[tuple[LocalModel1, ...], Meta(max_length=8)] = ()


class ContactModel2(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Version 2 of ``haptics.contact_model`` had a body a model."""

    tick: Annotated[int, Meta(ge=0)]
    ttl_s: Annotated[float, Meta(gt=0.0, le=0.1)]
    instruments: Annotated[tuple[LocalModel, ...], Meta(max_length=8)] = ()

    def lift(self) -> ContactModel:
        """Return the body of version 3: its table has a row a model."""
        return ContactModel.of(self.tick, self.ttl_s, self.instruments)


class ToolState1(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Version 1 carried rates and a torque that physics does not need."""

    position_m: Vec3
    velocity_m_s: Vec3 = ZERO3
    port_m: Vec3 = ZERO3
    roll_rad: float = 0.0
    jaw_angle_rad: float = 0.0
    jaw_rate_rad_s: float = 0.0
    closing_torque_nm: float = 0.0


class _ToolColumns(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """``haptics.contacts`` with an array a column."""

    tick: Annotated[int, Meta(ge=0)]
    tools: Annotated[tuple[Any, ...], Meta(max_length=8)]
    tool: Annotated[Array, spec("|i1", ("pairs",), "1")]
    tool_segment: Annotated[Array, spec("|i1", ("pairs",), "1")]
    target_kind: Annotated[Array, spec("|i1", ("pairs",), "1")]
    target: Annotated[Array, spec("<i4", ("pairs",), "index")]
    tool_parameter: Annotated[Array, spec("<f8", ("pairs",), "1")]
    target_weights: Annotated[Array, spec("<f8", ("pairs", 3), "1")]
    normal: Annotated[Array, spec("<f8", ("pairs", 3), "1")]
    gap_m: Annotated[Array, spec("<f8", ("pairs",), "m")]
    holds: Annotated[tuple[HeldPoint, ...], Meta(max_length=16)] = ()


class ToolContacts1(_ToolColumns, array_like=True, frozen=True, kw_only=True):
    """Version 1 of ``haptics.contacts`` told more of a tool."""

    tools: Annotated[tuple[ToolState1, ...], Meta(max_length=8)]


class ToolContacts2(_ToolColumns, array_like=True, frozen=True, kw_only=True):
    """Version 2 of ``haptics.contacts`` had an array a column."""

    tools: Annotated[tuple[ToolState, ...], Meta(max_length=8)]

    def lift(self) -> ToolContacts3:
        """Return the body of version 3: its tables are these columns side by side."""
        index = [self.tool, self.tool_segment, self.target_kind, self.target]
        geometry = [self.tool_parameter, self.target_weights, self.normal, self.gap_m]
        return ToolContacts3(
            tick=self.tick,
            tools=self.tools,
            pair_index=pack(np.column_stack([column.view() for column in index]), "<i4"),
            pair_geometry=pack(np.column_stack([column.view() for column in geometry])),
            holds=self.holds,
        )


class ToolContacts3(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Version 3 of ``haptics.contacts`` had a body a tool."""

    tick: Annotated[int, Meta(ge=0)]
    tools: Annotated[tuple[ToolState, ...], Meta(max_length=8)]
    pair_index: Annotated[Array, spec("<i4", ("pairs", 4), "1")]
    pair_geometry: Annotated[Array, spec("<f8", ("pairs", 8), "1")]
    holds: Annotated[tuple[HeldPoint, ...], Meta(max_length=16)] = ()

    def lift(self) -> ToolContacts4:
        """Return the body of version 4: its table has a row a tool."""
        return ToolContacts4(
            tick=self.tick,
            tools=tool_table(self.tools),
            pair_index=self.pair_index,
            pair_geometry=self.pair_geometry,
            holds=self.holds,
        )


class ToolContacts4(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Version 4 of ``haptics.contacts`` had the contact pairs of the tools, which physics finds for itself now."""

    tick: Annotated[int, Meta(ge=0)]
    tools: Annotated[Array, spec("<f8", ("tools", TOOL_COLUMNS), "1", row=ToolState)]
    pair_index: Annotated[Array, spec("<i4", ("pairs", 4), "1")]
    pair_geometry: Annotated[Array, spec("<f8", ("pairs", 8), "1")]
    holds: Annotated[tuple[HeldPoint, ...], Meta(max_length=16)] = ()
    begins: Annotated[int, Meta(ge=0)] = 0

    def lift(self) -> ToolContacts:
        """Return the body of version 5, without the pairs."""
        return ToolContacts(tick=self.tick, tools=self.tools, holds=self.holds, begins=self.begins)


class PhysicsState1(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Version 1 of ``physics.state`` had a body a tool."""

    tick: Annotated[int, Meta(ge=0)]
    tools: Annotated[tuple[ToolReaction, ...], Meta(max_length=8)]
    duct: Duct
    catheter: Catheter
    contacts: ContactForces

    def lift(self) -> PhysicsState:
        """Return the body of version 2: its table has a row a tool."""
        tools = reaction_table(self.tools)
        return PhysicsState(tick=self.tick, tools=tools, duct=self.duct, catheter=self.catheter, contacts=self.contacts)
