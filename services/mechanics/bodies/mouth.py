"""The duct's mouth: its plane, and how much of the catheter is beyond it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from services.mechanics.arrays import FloatArray
from services.mechanics.bodies.catheter import CatheterBody
from services.mechanics.bodies.wall_motion import wall_motion
from services.mechanics.reduction import ReducedDuct


class Mouth:
    """Plane through three nodes of the free rim, a third of it apart, moving with the modes."""

    def __init__(self, duct: ReducedDuct) -> None:
        rim = duct.mesh.vertex_sets["mouth"]
        self._nodes = rim[[0, len(rim) // 3, 2 * len(rim) // 3]]
        self._motion = wall_motion(duct, 1)

    def plane(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a point (3,) of the plane and its normal (3,), not normalised."""
        self._motion.update(q)
        corners = self._motion.positions(self._nodes, q)
        # Not np.cross, which takes longer than all the rest.
        (x, y, z), (u, v, w) = (corners[1:] - corners[0]).tolist()
        return corners.sum(axis=0) / 3.0, np.array([y * w - z * v, z * u - x * w, x * v - y * u])

    def inserted_length_m(self, q: FloatArray, catheter: CatheterBody, inside: npt.NDArray[np.int8]) -> float:
        """Return the rest length from where the catheter crosses the plane to its tip, if the tip is inside."""
        if not inside[-1]:
            return 0.0
        outside = np.flatnonzero(inside == 0)
        if outside.size == 0:
            return catheter.properties.length_m
        last = int(outside[-1])
        point, normal = self.plane(q)
        before, after = (catheter.state.position_m[last : last + 2] - point) @ normal
        # Flags and plane may disagree by a particle on the plane itself.
        s = min(max(before / (before - after), 0.0), 1.0) if before != after else 0.0
        n_beyond = inside.size - 1 - last - s
        return float(n_beyond * catheter.properties.segment_length_m)
