"""What the gateway says of the devices, every millisecond."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from trocar.protocol.vectors import IDENTITY_QUAT, ZERO3, Quat, Vec3


class InstrumentState(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """One instrument: a force-feedback arm and its handle. World frame, SI units."""

    name: Annotated[str, Meta(max_length=64, description="instrument name of the rig file")]
    position_m: Annotated[Vec3, Meta(description="HIP: the tool's junction point J")]
    orientation_wxyz: Annotated[Quat, Meta(description="+x along the shaft, from port to J; +y where jaw A opens")] = (
        IDENTITY_QUAT
    )
    velocity_m_s: Annotated[Vec3, Meta(description="velocity of the HIP")] = ZERO3
    handle_angle_rad: Annotated[float, Meta(description="0 closed, positive open")] = 0.0
    handle_rate_rad_s: Annotated[float, Meta(description="rate of the handle angle")] = 0.0
    buttons: Annotated[int, Meta(ge=0, lt=1 << 16, description="bit mask")] = 0
    port_m: Annotated[Vec3, Meta(description="the trocar's fixed point")] = ZERO3
    applied_force_n: Annotated[Vec3, Meta(description="force written to the arm in this tick")] = ZERO3
    applied_grasp_torque_nm: Annotated[float, Meta(description="torque written to the handle in this tick")] = 0.0
    state: Annotated[
        str, Meta(max_length=16, description="off, calibrating, ready, engaging, active, stale or fault")
    ] = "off"
    force_scale: Annotated[float, Meta(description="0 limp to 1 full: fade and engagement ramp")] = 0.0
    model_sequence: Annotated[int, Meta(description="sequence of the contact model in use, -1 none")] = -1
    model_age_s: Annotated[float, Meta(description="age of that model, -1 none")] = -1.0
    motor_temperature: Annotated[float, Meta(description="hottest motor, 0 ambient to 1 limit")] = 0.0
    has_force: Annotated[bool, Meta(description="false: a device without force feedback")] = True
    fault: Annotated[str, Meta(max_length=256, description="empty, or one sentence")] = ""
    roll_rad: Annotated[float, Meta(description="of the jaws about the shaft; pose = J, port and roll")] = 0.0


class GatewayState(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """The devices at one tick of the rig's clock."""

    tick: Annotated[int, Meta(ge=0, description="the rig's time, in milliseconds of the gateway's clock")]
    instruments: Annotated[tuple[InstrumentState, ...], Meta(max_length=8)] = ()
    begins: Annotated[
        int, Meta(ge=0, description="how often the scene was restarted; if it grows, all restart with this tick")
    ] = 0
    withdrawn: Annotated[
        int,
        Meta(ge=0, lt=1 << 8, description="bit mask of tools that touch nothing, after they kept force away"),
    ] = 0
