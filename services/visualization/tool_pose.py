"""Poses of the instruments for drawing: about the port, at the proxy during contact."""

from __future__ import annotations

import numpy as np

import trocar.protocol.bodies as bodies
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene.tool_orientation import tool_orientation


def junction(instrument: bodies.InstrumentState, reaction: bodies.ToolReaction | None) -> FloatArray:
    """Return J (3,): the proxy's during contact, otherwise the hand's."""
    if reaction is not None and (reaction.contacts > 0 or reaction.holds > 0):
        return np.array(reaction.proxy_position_m)
    return np.array(instrument.position_m)


def orientation(junction_m: FloatArray, port_m: tuple[float, float, float], roll_rad: float) -> FloatArray:
    """Return the quaternion wxyz of a tool: x along the shaft, y where jaw A opens; the identity at the port itself."""
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    tool_orientation(junction_m, np.array(port_m), roll_rad, quaternion)
    return quaternion
