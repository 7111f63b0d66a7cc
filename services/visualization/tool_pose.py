"""Poses of the forceps for drawing: about the port, at the proxy where the tissue holds the tool."""

from __future__ import annotations

from math import dist, sqrt

import numpy as np
import numpy.typing as npt

import protocol.bodies as bodies
from services.mechanics.bodies.forceps import tool_frame

Vector = npt.NDArray[np.float64]


def junction(instrument: bodies.InstrumentState, reaction: bodies.ToolReaction | None) -> Vector:
    """Return J (3,): where the tissue holds the tool if it touches, else where the hand is."""
    if reaction is not None and (reaction.contacts > 0 or reaction.holds > 0):
        return np.array(reaction.proxy_position_m)
    return np.array(instrument.position_m)


def tool_axes(junction_m: Vector, port_m: tuple[float, float, float], roll_rad: float) -> Vector:
    """Return the axes of the tool frame as columns (3, 3): x along the shaft, y the way jaw A opens, z the hinge."""
    if dist(junction_m, port_m) == 0.0:
        return np.eye(3)
    rows = np.empty((3, 3))
    tool_frame(junction_m, np.array(port_m), roll_rad, rows)
    opening, hinge, shaft = rows
    return np.stack([shaft, opening, hinge], axis=1)


def quaternion(axes: Vector) -> Vector:
    """Return the quaternion wxyz of a rotation matrix; its largest component is found first, so nothing is lost."""
    trace = np.trace(axes)
    squares = np.array([trace, *(2.0 * np.diag(axes) - trace)])  # four times each component squared, less one
    k = int(np.argmax(squares))
    top = 0.5 * sqrt(1.0 + squares[k])
    skew = np.array([axes[2, 1] - axes[1, 2], axes[0, 2] - axes[2, 0], axes[1, 0] - axes[0, 1]]) / (4.0 * top)
    q = np.empty(4)
    if k == 0:
        q[0], q[1:] = top, skew
    else:
        q[0] = skew[k - 1]
        q[1:] = (axes[k - 1] + axes[:, k - 1]) / (4.0 * top)
        q[k] = top
    return q
