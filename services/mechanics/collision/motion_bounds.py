"""How far vertices of the wall can move, alone and against one another, as the search tree wants to know it.

Linear modes: with C_i = Phi_i Lambda^-1 Phi_i^T, the modal compliance of node i, every displacement obeys
|u_i| <= sqrt(lambda_max(C_i)) |omega q| (Cauchy-Schwarz; |omega q|^2 is twice the elastic energy), and the
displacement relative to another node obeys the same with Phi_i - Phi_j.

Turned cross-sections carry every vertex along rigidly; that part is measured each tick (`turned.note_turns`), and
``reach`` is what is left. Against one another vertices are bounded ahead: positions are no longer linear in q, but
the derivative of a difference by omega q is below a quadratic polynomial in E = |omega q|, whose coefficients follow
from the same singular values: rotations are 1-Lipschitz in their vector, the left Jacobian is at most 1 and
1/2-Lipschitz. With a common beta every such polynomial is below its own factor times (1 + beta E)^2, so the tree
still needs only one number a vertex, times E (1 + beta E)^2.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.reduction.large_rotations.warping import TubeWarp


class MotionBounds(Protocol):
    """Bounds in m per unit of E (1 + growth E)^2, E = |omega q| in sqrt(J); those of changes are the same."""

    @property
    def growth(self) -> float:
        """beta, in 1/sqrt(J)."""

    def reach(self, vertex: IntArray) -> FloatArray:
        """Bound the motion of vertices (k,), beside that of their sections."""

    def spread(self, vertex: IntArray, other: IntArray) -> FloatArray:
        """Bound the motion of vertices (k,) against others (k,)."""


class LinearBounds:
    """Of x = X + Phi q; ``scaled_modes`` (n, 3, r) is Phi / omega."""

    growth = 0.0

    def __init__(self, scaled_modes: FloatArray) -> None:
        self._modes = scaled_modes

    def reach(self, vertex: IntArray) -> FloatArray:
        """Bound the motion of vertices (k,)."""
        return largest_gain(self._modes[vertex])

    def spread(self, vertex: IntArray, other: IntArray) -> FloatArray:
        """Bound the motion of vertices (k,) against others (k,)."""
        return largest_gain(self._modes[vertex] - self._modes[other])


class TurnedBounds:
    """Of the warped position c + Q (arm + local q), the axis c strung together from turned pieces."""

    def __init__(self, warp: TubeWarp, omega_rad_s: FloatArray) -> None:
        sections, turn = warp.sections, warp.turn / omega_rad_s
        self._turn = _interpolated(turn, sections.segment, sections.fraction)
        self._local, self._arm = warp.local / omega_rad_s, warp.arm_m
        self._turn_gain, self._local_gain = largest_gain(self._turn), largest_gain(self._local)
        self._arm_length = np.linalg.norm(warp.arm_m, axis=1)
        self._axis = _axis_bounds(warp, turn, omega_rad_s)
        self.growth = 0.5 * float(self._turn_gain.max())

    def reach(self, vertex: IntArray) -> FloatArray:
        """Bound the motion of vertices (k,) in their sections."""
        gain: FloatArray = self._local_gain[vertex]
        return gain

    def spread(self, vertex: IntArray, other: IntArray) -> FloatArray:
        """Bound the motion of vertices (k,) against others (k,)."""
        along = np.abs(self._axis[:, vertex] - self._axis[:, other])
        d_turn = largest_gain(self._turn[vertex] - self._turn[other])
        d_local = largest_gain(self._local[vertex] - self._local[other])
        d_arm = np.linalg.norm(self._arm[vertex] - self._arm[other], axis=1)
        turn, arm, local = self._turn_gain[other], self._arm_length[vertex], self._local_gain[vertex]
        # (w_j) x (Q_i y_i - Q_j y_j)  +  (w_i - w_j) x Q_i y_i  +  (Q_i - Q_j) dL_i  +  Q_j (dL_i - dL_j),
        # with y = arm + local q and w the rate of turn; powers of E collected.
        constant = along[0] + turn * d_arm + d_turn * arm + d_local
        first = along[1] + turn * d_local + d_turn * (1.5 * turn * arm + 2.0 * local)
        second = 1.5 * turn * d_turn * local
        return self._covered(constant, first, second)

    def _covered(self, constant: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return the least factor f with f (1 + beta E)^2 >= constant + first E + second E^2 for every E."""
        beta = self.growth
        if beta == 0.0:
            return constant
        covered: FloatArray = np.maximum(constant, np.maximum(first / (2.0 * beta), second / beta**2))
        return covered


def _axis_bounds(warp: TubeWarp, turn: FloatArray, omega_rad_s: FloatArray) -> FloatArray:
    """Return (2, n) bounds of the motion of each node's point of the axis: the constant part and that times E."""
    sections = warp.sections
    turns = largest_gain(0.5 * (turn[:-1] + turn[1:]))
    stretch = largest_gain(warp.stretch / omega_rad_s)
    lengths = np.linalg.norm(np.diff(sections.centres_m, axis=0), axis=1)
    pieces = np.stack([turns * lengths + stretch, turns * stretch], axis=1)
    stations = np.concatenate([np.zeros((1, 2)), np.cumsum(pieces, axis=0)])
    return np.ascontiguousarray(_interpolated(stations, sections.segment, sections.fraction).T)


def _interpolated(stations: FloatArray, segment: IntArray, fraction: FloatArray) -> FloatArray:
    share = fraction.reshape(-1, *([1] * (stations.ndim - 1)))
    between: FloatArray = (1.0 - share) * stations[segment] + share * stations[segment + 1]
    return between


def largest_gain(modes: FloatArray) -> FloatArray:
    """(k,) largest singular value of each (3, r) block, rounded up."""
    gram = modes @ modes.transpose(0, 2, 1)
    largest = np.linalg.eigvalsh(gram)[:, -1]
    gain: FloatArray = np.sqrt(np.maximum(largest, 0.0)) * (1.0 + 1e-9)
    return gain
