"""Positions and velocities of a rod's particles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.rod.material_frame import MaterialFrame
from trocar.services.mechanics.rod.properties import RodProperties


@dataclass
class RodState:
    """Particles of the centreline; integrators change the arrays in place.

    Attributes:
        position_m, velocity_m_s: (n, 3), n = n_segments + 1.
        frame: The material frame of a rod with torsional stiffness; None for one without, and until the first step
            makes an untwisted one.
        slow_velocity_m_s: (n, 3) velocities that follow the others within about a step: the memory of the implicit
            step's numerical damping. None before the first step, and where velocities were set by hand: the step then
            starts anew.
    """

    position_m: FloatArray
    velocity_m_s: FloatArray
    frame: MaterialFrame | None = None
    slow_velocity_m_s: FloatArray | None = None

    def copy(self) -> RodState:
        """Return an independent state with the same values."""
        frame = None if self.frame is None else self.frame.copy()
        slow = None if self.slow_velocity_m_s is None else self.slow_velocity_m_s.copy()
        return RodState(self.position_m.copy(), self.velocity_m_s.copy(), frame, slow)

    def halt(self) -> None:
        """Stop all motion at the present position."""
        self.velocity_m_s[:] = 0.0
        self.slow_velocity_m_s = None


def straight_rod(properties: RodProperties, start_m: ArrayLike, direction: ArrayLike) -> RodState:
    """Return an unstretched rod at rest from ``start_m`` along ``direction``, which may have any length.

    Raises ValueError if the direction is zero.
    """
    axis = np.asarray(direction, dtype=np.float64)
    norm = float(np.linalg.norm(axis))
    if not norm > 0.0:
        raise ValueError("the direction of a straight rod must not be zero")
    distance = np.linspace(0.0, properties.length_m, properties.n_particles)
    position = np.asarray(start_m, dtype=np.float64) + distance[:, None] * (axis / norm)
    return RodState(np.ascontiguousarray(position), np.zeros((properties.n_particles, 3)))


def rod_along(properties: RodProperties, curve_m: ArrayLike) -> RodState:
    """Return a rod at rest along a polyline (k, 3) from its first point, particles equally spaced by arc length.

    Raises ValueError if the polyline is shorter than the rod.
    """
    points = np.asarray(curve_m, dtype=np.float64)
    arc = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    if arc[-1] < properties.length_m * (1.0 - 1e-9):
        raise ValueError(f"the curve is {arc[-1]:.6g} m long, shorter than the rod of {properties.length_m:.6g} m")
    at = np.minimum(np.linspace(0.0, properties.length_m, properties.n_particles), arc[-1])
    position = np.stack([np.interp(at, arc, points[:, axis]) for axis in range(3)], axis=1)
    return RodState(np.ascontiguousarray(position), np.zeros((properties.n_particles, 3)))
