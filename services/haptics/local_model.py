"""From a solved reaction to the local model that the servo evaluates between frames."""

from __future__ import annotations

import struct

from protocol.bodies import InstrumentState, ToolReaction
from protocol.bodies.haptics import MODEL_COLUMNS
from protocol.vectors import Mat3
from services.mechanics.scene import ForcepsScene

_pack = struct.Struct(f"<{MODEL_COLUMNS}d").pack
FREE = bytes(8 * MODEL_COLUMNS)


def local_model(reaction: ToolReaction, instrument: InstrumentState, forceps: ForcepsScene, *, touching: bool) -> bytes:
    """Return ``f = f0 - K (x - x0) - B (v - v0)`` about the hand that the reaction was solved for; for the jaws too.

    What is returned are the bytes of a row of `ContactModel.models`.

    K is the local stiffness that physics found at the tool, virtual coupling included, so the hand meets the right
    wall although the force is a tick or two old. B is the coupling's damping and resists the present velocity. A tool
    that touches nothing gets the free model: no force is ever drawn out of thin air. A handle beyond the stops of its
    jaws does not move them: there the torque stays what it is.
    """
    in_contact = touching and (reaction.contacts > 0 or reaction.holds > 0)
    if not in_contact:
        return FREE
    ratio = forceps.jaw_ratio
    moves_jaws = ratio if 0.0 < reaction.jaw_angle_rad < forceps.jaw_max_angle_rad else 0.0
    return _pack(
        *reaction.force_n,
        *reaction.stiffness_n_m,
        *felt_damping(reaction.stiffness_n_m, forceps),
        *reaction.position_m,
        *instrument.velocity_m_s,
        reaction.grasp_torque_nm * ratio,
        max(0.0, reaction.grasp_stiffness_nm_rad) * moves_jaws**2,
        forceps.jaw_damping_nm_s_rad * moves_jaws**2,
        reaction.jaw_angle_rad / ratio,
        instrument.handle_rate_rad_s,
        1.0,
    )


def felt_damping(stiffness_n_m: Mat3, forceps: ForcepsScene) -> Mat3:
    r"""Return the damping (9,) in N s/m that the hand feels of the coupling's, in series with what the tool touches.

    Coupling :math:`K_c + b s` and world :math:`K_w` in series are :math:`K + B s` for slow hands, with
    :math:`K = K_c K_w / (K_c + K_w)` and :math:`B = b\, (K / K_c)^2`: what gives way gives way to the damper too. In
    three directions :math:`B = b K K^T / K_c^2`, positive semi-definite. At a stiff wall that is all of b; at a soft
    one all of it would be noise of the encoders: 10 mN, where a catheter pushes with 30.
    """
    a, b, c, d, e, f, g, h, i = stiffness_n_m
    scale = forceps.coupling_damping_n_s_m / forceps.coupling_stiffness_n_m**2
    xy, xz, yz = (a * d + b * e + c * f) * scale, (a * g + b * h + c * i) * scale, (d * g + e * h + f * i) * scale
    xx, yy, zz = (a * a + b * b + c * c) * scale, (d * d + e * e + f * f) * scale, (g * g + h * h + i * i) * scale
    return xx, xy, xz, xy, yy, yz, xz, yz, zz
