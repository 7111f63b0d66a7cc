"""Bounds on the motion of any node of the wall with the modes since its triangles were listed.

With linear kinematics the bound is a sum over blocks of modes: with omega the frequencies, |Phi_i dq| is at most the
largest singular value of Phi_i / omega times |omega dq| (Cauchy-Schwarz). In a wall whose sections rotate, the motion
of the sections is added, which acts on the nodes' arms; the remaining motion is bounded in the same way.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from services.mechanics.arrays import FloatArray, LongArray
from services.mechanics.compiled import kernel
from services.mechanics.reduction.large_rotations.warping import SectionFrame
from services.mechanics.reduction.reduced_duct import ReducedDuct

_BLOCKS = 8
"""Number of blocks of modes; blocks of soft modes, which move far, are smaller."""


Blocks = tuple[FloatArray, LongArray, FloatArray]
"""Frequencies (r,) of the modes, edges (b + 1,) of blocks of them, and the gain (b,) of each block."""


class WallBounds:
    """Bounds the motion of the nodes from a reference state, for a wall with linear kinematics."""

    def __init__(self, Phi: FloatArray, omega_rad_s: FloatArray) -> None:
        r = len(omega_rad_s)
        edges = np.unique(np.round(r * np.linspace(0.0, 1.0, _BLOCKS + 1) ** 1.5).astype(int))
        spans = list(itertools.pairwise(edges))
        gain = np.array([largest_gain(Phi[:, :, a:b] / omega_rad_s[a:b]).max() for a, b in spans])
        self.blocks: Blocks = np.ascontiguousarray(omega_rad_s), edges, gain
        self._reference = np.zeros(r)

    def set_reference(self, q: FloatArray) -> None:
        """Count from these coordinates (r,); a copy of these bounds keeps its own."""
        self._reference = q.copy()

    def moved_m(self, q: FloatArray) -> float:
        """Return a bound, in m, on any node's motion from the reference, without that by loads."""
        return float(moved_by_blocks(self.blocks, self._reference, q))


class RotatingBounds(WallBounds):
    """Bounds the motion of the nodes of a wall whose sections rotate."""

    def __init__(self, duct: ReducedDuct) -> None:
        if duct.warp is None:
            raise ValueError("a wall that turns needs a duct with a warp")
        super().__init__(duct.warp.local, duct.basis.omega_rad_s)
        self._at_rest = np.zeros_like(self._reference)
        self._frame = SectionFrame(duct.warp)
        self._arm_m = float(np.linalg.norm(duct.warp.arm_m, axis=1).max())
        self._rotations, self._centres_m = self._frame.turns.copy(), self._frame.centres_m.copy()

    def set_reference(self, q: FloatArray) -> None:
        """Count from these coordinates (r,)."""
        super().set_reference(q)
        self._frame.update(q)
        self._rotations, self._centres_m = self._frame.turns.copy(), self._frame.centres_m.copy()

    def moved_m(self, q: FloatArray) -> float:
        """Return a bound, in m, on any node's motion from the reference, without that by loads."""
        return super().moved_m(q) + self.rotated_m(q)

    def rotated_m(self, q: FloatArray, beyond_m: float = 0.0) -> float:
        """Return the part of the sections, which move nodes by their arms; loads lengthen these by ``beyond_m``."""
        self._frame.update(q)
        rotated = np.linalg.norm(self._frame.turns - self._rotations, axis=1).max()
        carried = np.linalg.norm(self._frame.centres_m - self._centres_m, axis=1).max()
        local_m = float(moved_by_blocks(self.blocks, self._at_rest, q))
        return float(carried + rotated * (self._arm_m + local_m + beyond_m))


def wall_bounds(duct: ReducedDuct) -> WallBounds:
    """Return the bounds of a duct's wall."""
    return WallBounds(duct.basis.Phi, duct.basis.omega_rad_s) if duct.warp is None else RotatingBounds(duct)


@kernel
def moved_by_blocks(blocks: Blocks, reference: FloatArray, q: FloatArray) -> float:
    """Return the sum over blocks of modes of their gain times |omega (q - reference)|."""
    (omega, edges, gain), total = blocks, 0.0
    for block in range(gain.shape[0]):
        square = 0.0
        for mode in range(edges[block], edges[block + 1]):
            square += (omega[mode] * (q[mode] - reference[mode])) ** 2
        total += gain[block] * math.sqrt(square)
    return total


def largest_gain(modes: FloatArray) -> FloatArray:
    """Return the largest singular value (k,) of each (3, r) block, rounded up."""
    gram = modes @ modes.transpose(0, 2, 1)
    largest = np.linalg.eigvalsh(gram)[:, -1]
    gain: FloatArray = np.sqrt(np.maximum(largest, 0.0)) * (1.0 + 1e-9)
    return gain
