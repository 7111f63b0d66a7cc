"""Laparoscopic forceps: kinematics about the port, virtual coupling and grasp."""

from trocar.services.mechanics.bodies.forceps.grasp import Grasp, JawState
from trocar.services.mechanics.bodies.forceps.kinematics import (
    contact_lever,
    jaw_angle_from_handle,
    tool_frame,
    tool_segments,
)
from trocar.services.mechanics.bodies.forceps.tool_body import ToolBody

__all__ = ["Grasp", "JawState", "ToolBody", "contact_lever", "jaw_angle_from_handle", "tool_frame", "tool_segments"]
