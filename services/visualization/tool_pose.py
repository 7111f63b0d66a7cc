"""Poses of the forceps for drawing: about the port, at the proxy where the tissue holds the tool."""

from __future__ import annotations

import numpy as np

import protocol.bodies as bodies
from services.mechanics.arrays import FloatArray
from services.mechanics.scene.tool_orientation import tool_orientation


def junction(instrument: bodies.InstrumentState, reaction: bodies.ToolReaction | None) -> FloatArray:
    """Return J (3,): where the tissue holds the tool if it touches, else where the hand is."""
    if reaction is not None and (reaction.contacts > 0 or reaction.holds > 0):
        return np.array(reaction.proxy_position_m)
    return np.array(instrument.position_m)


def orientation(junction_m: FloatArray, port_m: tuple[float, float, float], roll_rad: float) -> FloatArray:
    """Return the quaternion wxyz of a tool: x along the shaft, y where jaw A opens; no turn where it is in its port."""
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    tool_orientation(junction_m, np.array(port_m), roll_rad, quaternion)
    return quaternion
