"""The material frame: one director per segment and clamped end, carried along by parallel transport in time.

Discrete elastic rods (Bergou, Wardetzky, Robinson, Audoly, Grinspun 2008; Bergou, Audoly, Vouga, Wardetzky, Grinspun
2010): the twist of a joint is the angle from the director before it, transported along the rod, to the one behind it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector, cross, dot, row
from trocar.services.mechanics.rod.elasticity import any_normal

Frame = tuple[FloatArray, FloatArray, FloatArray]  # tangent (m, 3), m1 (m, 3), twist of the joints (m-1,)
NO_WALLS = np.full((2, 3), np.nan)


@dataclass
class MaterialFrame:
    """The roll of the material about the centreline: one director per segment, and one in the wall of a clamped end.

    The walls stand before the first segment and behind the last one, with directions of their own, so that a rod of n
    particles has m = n - 1 directors and up to two more. "First" and "last" below mean the walls where there are any.

    Attributes:
        tangent, m1: (m, 3) unit vectors, m1 normal to the tangent; the third director is tangent x m1.
        twist_rad: (m - 1,) angle of each joint, whole turns counted.
        end_is_held: Whether the roll of the last director is prescribed; that of the first always is.
    """

    tangent: FloatArray
    m1: FloatArray
    twist_rad: FloatArray
    end_is_held: bool = False

    def copy(self) -> MaterialFrame:
        """Return an independent frame with the same values."""
        return MaterialFrame(self.tangent.copy(), self.m1.copy(), self.twist_rad.copy(), self.end_is_held)


def initial_frame(
    position_m: FloatArray, first_m1: Vector | None = None, walls: FloatArray = NO_WALLS
) -> MaterialFrame:
    """Return frames without twist along a centreline (n, 3).

    Args:
        position_m: (n, 3) particles.
        first_m1: The first director, from which the others are transported; made normal to its tangent. Any normal if
            None.
        walls: (2, 3) directions of the clamped ends, as `Supports.wall_directions` gives them; NaN where an end is
            free.
    """
    start_wall, end_wall = (wall[None] for wall in walls)
    edges = np.concatenate([start_wall, np.diff(position_m, axis=0), end_wall])
    edges = edges[~np.isnan(edges[:, 0])]
    tangent = edges / np.linalg.norm(edges, axis=1)[:, None]
    m1 = np.zeros_like(tangent)
    start = row(tangent, 0)
    m1[0] = any_normal(start) if first_m1 is None else _unit(_normal_part(start, first_m1))
    for j in range(1, len(m1)):
        m1[j] = transport(row(m1, j - 1), row(tangent, j - 1), row(tangent, j))
    return MaterialFrame(tangent, m1, np.zeros(len(m1) - 1))


def roll(frame: MaterialFrame, segment: int, angle_rad: float) -> None:
    """Turn the first (0) or last (-1) director in place by an angle of any size about its tangent.

    A hand that rolls the rod does this; a roll of the last director lasts only if ``frame.end_is_held``.
    """
    last = len(frame.m1) - 1
    rotate_frame((frame.tangent, frame.m1, frame.twist_rad), segment % (last + 1), angle_rad)


@kernel
def _normal_part(t: Vector, m: Vector) -> Vector:
    along = dot(t, m)
    return (m[0] - along * t[0], m[1] - along * t[1], m[2] - along * t[2])


@kernel
def _unit(m: Vector) -> Vector:
    scale = 1.0 / math.sqrt(dot(m, m))
    return (m[0] * scale, m[1] * scale, m[2] * scale)


@kernel
def transport(m: Vector, t: Vector, u: Vector) -> Vector:
    """Return a director m in parallel transport from tangent t to u: by the least rotation that takes t to u."""
    b = cross(t, u)
    c = dot(t, u)
    turned = m
    if 1.0 + c > 1e-12:
        s = dot(b, m) / (1.0 + c)
        w = cross(b, m)
        turned = (c * m[0] + w[0] + s * b[0], c * m[1] + w[1] + s * b[1], c * m[2] + w[2] + s * b[2])
    normal: Vector = _unit(_normal_part(u, turned))
    return normal


@kernel
def rotate_frame(frame: Frame, j: int, angle: float) -> None:
    """Turn segment j's director about its tangent, and update the twist of its joints."""
    tangent, m1, twist = frame
    m = row(m1, j)
    m2 = cross(row(tangent, j), m)
    cosine = math.cos(angle)
    sine = math.sin(angle)
    for c in range(3):
        m1[j, c] = cosine * m[c] + sine * m2[c]
    if j > 0:
        twist[j - 1] += angle
    if j < twist.shape[0]:
        twist[j] -= angle


@kernel
def follow(x: FloatArray, frame: Frame, first: int) -> None:
    """Transport the directors to the tangents of positions ``x``, and measure the twist of each joint (turns counted).

    ``first`` is the row of the first segment, 1 behind a wall; walls stay.
    """
    tangent, m1, twist = frame
    for j in range(first, first + x.shape[0] - 1):
        k = j - first
        e = (x[k + 1, 0] - x[k, 0], x[k + 1, 1] - x[k, 1], x[k + 1, 2] - x[k, 2])
        length = math.sqrt(dot(e, e))
        if length > 0.0:
            u = (e[0] / length, e[1] / length, e[2] / length)
            m = transport(row(m1, j), row(tangent, j), u)
            for c in range(3):
                tangent[j, c] = u[c]
                m1[j, c] = m[c]
    for i in range(twist.shape[0]):
        u = row(tangent, i + 1)
        m = row(m1, i + 1)
        p = transport(row(m1, i), row(tangent, i), u)
        angle = math.atan2(dot(cross(p, m), u), dot(p, m))
        twist[i] = angle + 2.0 * math.pi * round((twist[i] - angle) / (2.0 * math.pi))
