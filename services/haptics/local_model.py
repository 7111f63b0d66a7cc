"""From a solved reaction to the local model that the servo evaluates between frames."""

from __future__ import annotations

from protocol.bodies import InstrumentState, LocalModel, ToolReaction
from services.mechanics.scene import ForcepsScene

FREE = LocalModel()


def local_model(
    reaction: ToolReaction, instrument: InstrumentState, forceps: ForcepsScene, *, touching: bool
) -> LocalModel:
    """Return ``f = f0 - K (x - x0) - B (v - v0)`` about the hand that the reaction was solved for; for the jaws too.

    K is the local stiffness that physics found at the tool, virtual coupling included, so the hand meets the right
    wall although the force is a tick or two old. B is the coupling's damping and resists the present velocity. A tool
    that touches nothing gets the free model: no force is ever drawn out of thin air. A handle beyond the stops of its
    jaws does not move them: there the torque stays what it is.
    """
    in_contact = touching and (reaction.contacts > 0 or reaction.holds > 0)
    if not in_contact:
        return FREE
    b, ratio = forceps.coupling_damping_n_s_m, forceps.jaw_ratio
    moves_jaws = ratio if 0.0 < reaction.jaw_angle_rad < forceps.jaw_max_angle_rad else 0.0
    return LocalModel(
        force_n=reaction.force_n,
        stiffness_n_m=reaction.stiffness_n_m,
        damping_n_s_m=(b, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, b),
        reference_position_m=reaction.position_m,
        reference_velocity_m_s=instrument.velocity_m_s,
        grasp_torque_nm=reaction.grasp_torque_nm * ratio,
        grasp_stiffness_nm_rad=max(0.0, reaction.grasp_stiffness_nm_rad) * moves_jaws**2,
        grasp_damping_nm_s_rad=forceps.jaw_damping_nm_s_rad * moves_jaws**2,
        reference_angle_rad=reaction.jaw_angle_rad / ratio,
        reference_rate_rad_s=instrument.handle_rate_rad_s,
        in_contact=True,
    )
