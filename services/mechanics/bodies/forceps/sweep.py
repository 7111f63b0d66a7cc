"""Path of a tool towards the commanded pose of its hand, at a bounded speed.

A hand cannot jump, but ticks get lost and callers may pass any pose. The path is that of an instrument in its
port: the shaft swings in the plane of both directions while its length, roll and opening change.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import cross, unit

# Instruments of bariatric surgery, the longest there are, have 0.45 m of shaft; J is no further from the port.
LONGEST_SHAFT_M = 0.5
# In training tasks instruments move at 0.05 to 0.3 m/s; at a tick of 1 ms, contact detection looks ahead for 0.5 m/s.
# Faster hands, up to the 1.2 m/s at which an arm trips, are followed with a delay.
FASTEST_HAND_M_S = 0.5
_STRAIGHT = 1e-12


@inlined_kernel
def sweep(
    port: FloatArray,
    pose: tuple[FloatArray, float],
    target: tuple[FloatArray, float, float],
    sizes: tuple[float, float],
    out: FloatArray,
) -> float:
    """Write J and opening at the end of the step into ``out`` (4,), and return the roll there.

    ``pose`` is (J with opening (4,), roll) at its start, ``target`` the commanded (J, opening, roll), and ``sizes``
    (length of the jaws, largest motion of J) in m. A target within reach is reached exactly.
    """
    (start, roll), (junction, opening, asked_roll) = pose, target
    share = _share(port, pose, target, sizes)
    if share >= 1.0:
        for axis in range(3):
            out[axis] = junction[axis]
        out[3] = opening
        return asked_roll
    _swing(port, start, junction, share, out)
    out[3] = start[3] + share * (opening - start[3])
    return roll + share * (asked_roll - roll)


@inlined_kernel
def _share(
    port: FloatArray,
    pose: tuple[FloatArray, float],
    target: tuple[FloatArray, float, float],
    sizes: tuple[float, float],
) -> float:
    """Return the fraction of the path that J and the jaws' tips may move in a step; above 1 if they arrive."""
    (start, roll), (junction, opening, asked_roll), (jaw_length, reach) = pose, target, sizes
    before, after, angle = _polar(port, start, junction)
    way = math.hypot(after - before, angle * max(before, after))
    turn = jaw_length * (abs(asked_roll - roll) + 0.5 * abs(opening - start[3]))
    longest = max(way, turn)
    return reach / longest if longest > 0.0 else 1.0


@kernel
def _polar(port: FloatArray, start: FloatArray, end: FloatArray) -> tuple[float, float, float]:
    """Return the distances of two points from the port and the angle between them there."""
    before, after, along, across = 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        a, b = start[axis] - port[axis], end[axis] - port[axis]
        before, after, along = before + a * a, after + b * b, along + a * b
        i, j = (axis + 1) % 3, (axis + 2) % 3
        normal = (start[i] - port[i]) * (end[j] - port[j]) - (start[j] - port[j]) * (end[i] - port[i])
        across += normal * normal
    return math.sqrt(before), math.sqrt(after), math.atan2(math.sqrt(across), along)


@inlined_kernel
def _swing(port: FloatArray, start: FloatArray, end: FloatArray, share: float, out: FloatArray) -> None:
    """Write the point at ``share`` of the swing about the port from ``start`` to ``end`` into ``out``."""
    before, after, angle = _polar(port, start, end)
    length, sine, size = before + share * (after - before), math.sin(angle), 0.0
    first, second, third = 1.0 - share, share, 0.0
    across = (0.0, 0.0, 0.0)
    if sine > _STRAIGHT:
        first, second = math.sin((1.0 - share) * angle) / sine, math.sin(share * angle) / sine
    elif angle > 1.0:  # straight through the port: any plane will do
        first, second, third = math.cos(share * angle), 0.0, math.sin(share * angle)
        x, y, z = start[0] - port[0], start[1] - port[1], start[2] - port[2]
        across = unit(cross((x, y, z), (1.0, 0.0, 0.0) if abs(x) < 0.6 * before else (0.0, 1.0, 0.0)))
    for axis in range(3):
        out[axis] = first * (start[axis] - port[axis]) / before + second * (end[axis] - port[axis]) / after
        out[axis] += third * across[axis]
        size += out[axis] * out[axis]
    size = math.sqrt(size)
    for axis in range(3):
        out[axis] = port[axis] + length / size * out[axis]
