"""The duct's mouth: its plane, and how much of the catheter is beyond it."""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import ByteArray, FloatArray
from services.mechanics.bodies.catheter import CatheterBody
from services.mechanics.bodies.wall_motion import wall_motion
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector, dot, row, subtract
from services.mechanics.reduction import ReducedDuct


class Mouth:
    """Plane through three nodes of the free rim, a third of it apart, moving with the modes."""

    def __init__(self, duct: ReducedDuct) -> None:
        rim = duct.mesh.vertex_sets["mouth"]
        self._nodes = rim[[0, len(rim) // 3, 2 * len(rim) // 3]]
        self._motion = wall_motion(duct, 1)
        self._rest_m = np.ascontiguousarray(duct.mesh.vertices_m[self._nodes])
        self._modes = np.ascontiguousarray(duct.basis.Phi[self._nodes])
        self._is_straight = duct.warp is None

    def inserted_length_m(self, q: FloatArray, catheter: CatheterBody, inside: ByteArray) -> float:
        """Return the rest length from where the catheter crosses the plane to its tip, if the tip is inside.

        ``inside`` (n,) is one where a particle is in the lumen.
        """
        if not inside.size:
            return 0.0
        segment_m, position_m = catheter.properties.segment_length_m, catheter.state.position_m
        if self._is_straight:
            return inserted_by_modes(self._rest_m, self._modes, q, position_m, inside, segment_m)
        self._motion.update(q)
        return inserted_beyond(self._motion.positions(self._nodes, q), position_m, inside, segment_m)


@kernel
def inserted_by_modes(
    rest: FloatArray, modes: FloatArray, q: FloatArray, position: FloatArray, inside: ByteArray, segment_m: float
) -> float:
    """Return what `inserted_beyond` does of the plane through rest (3, 3) + modes (3, 3, r) q."""
    return _length(
        (_moved(rest, modes, q, 0), _moved(rest, modes, q, 1), _moved(rest, modes, q, 2)), position, inside, segment_m
    )


@kernel
def inserted_beyond(corners: FloatArray, position: FloatArray, inside: ByteArray, segment_m: float) -> float:
    """Return the rest length of particles (n, 3) beyond the plane through three corners (3, 3), in m."""
    return _length((row(corners, 0), row(corners, 1), row(corners, 2)), position, inside, segment_m)


@kernel
def _moved(rest: FloatArray, modes: FloatArray, q: FloatArray, corner: int) -> Vector:
    x, y, z = rest[corner, 0], rest[corner, 1], rest[corner, 2]
    for mode in range(q.shape[0]):
        x += modes[corner, 0, mode] * q[mode]
        y += modes[corner, 1, mode] * q[mode]
        z += modes[corner, 2, mode] * q[mode]
    return (x, y, z)


@kernel
def _length(corners: tuple[Vector, Vector, Vector], position: FloatArray, inside: ByteArray, segment_m: float) -> float:
    n = inside.shape[0]
    if not inside[n - 1]:
        return 0.0
    last = n - 1
    while last >= 0 and inside[last]:
        last -= 1
    if last < 0:
        return float((n - 1) * segment_m)
    first, (x, y, z), (u, v, w) = corners[0], subtract(corners[1], corners[0]), subtract(corners[2], corners[0])
    normal = (y * w - z * v, z * u - x * w, x * v - y * u)
    before, after = (
        dot(subtract(row(position, last), first), normal),
        dot(subtract(row(position, last + 1), first), normal),
    )
    # Flags and plane may disagree by a particle on the plane itself.
    s = min(max(before / (before - after), 0.0), 1.0) if before != after else 0.0
    return float((n - 1 - last - s) * segment_m)
