"""The frame that a triangle carries along: its plane, and the best fit of its corners within the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.nonlinear.rotations import skew
from trocar.services.mechanics.fem.triangle import shape_gradients


@dataclass(frozen=True)
class CarriedFrame:
    """Frames of many triangles.

    Attributes:
        axes: (k, 3, 3) rows are the axes in global components.
        now, flat: (k, 3, 2) corners about their centroid, in the frame: at present, and undeformed.
        spin: (k, 3, 18) turn of the frame, in its own axes, from local displacements and spins of the corners.
    """

    axes: FloatArray
    now: FloatArray
    flat: FloatArray
    spin: FloatArray

    @classmethod
    def fit(cls, corners_m: FloatArray, flat: FloatArray) -> CarriedFrame:
        """Frames of triangles whose corners are (k, 3, 3) and were (k, 3, 2) about their centroid in the plane."""
        relative = corners_m - corners_m.mean(axis=1, keepdims=True)
        side = corners_m[:, 1] - corners_m[:, 0]
        normal = np.cross(side, corners_m[:, 2] - corners_m[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        first = side / np.linalg.norm(side, axis=1, keepdims=True)
        plane = np.stack([first, np.cross(normal, first)], axis=1)
        y = relative @ plane.transpose(0, 2, 1)
        angle = np.arctan2(_cross(flat, y), np.sum(flat * y, axis=(1, 2)))
        c, s = np.cos(angle), np.sin(angle)
        turn = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
        axes = np.concatenate([turn @ plane, normal[:, None]], axis=1)
        now = y @ turn.transpose(0, 2, 1)
        return cls(axes, now, flat, _spin(now, flat))

    def stretched(self) -> FloatArray:
        """(k, 3, 3) displacements that the frame sees; none across the plane."""
        across = np.zeros((*self.now.shape[:2], 1))
        return np.concatenate([self.now - self.flat, across], axis=2)

    def projector(self) -> FloatArray:
        """(k, 18, 18) P: what the frame sees of local displacements and spins, rigid motion removed."""
        P = np.zeros((len(self.now), 3, 2, 3, 3, 2, 3))
        P[:, :, 0, :, :, 0] = np.einsum("ab,ij->aibj", np.eye(3) - 1.0 / 3.0, np.eye(3))
        P[:, :, 1, :, :, 1] = np.einsum("ab,ij->aibj", np.eye(3), np.eye(3))
        flat: FloatArray = P.reshape(-1, 18, 18) - self._rigid() @ self.spin
        return flat

    def _rigid(self) -> FloatArray:
        """(k, 18, 3) local displacements and spins of unit turns about the centroid."""
        rigid = np.zeros((len(self.now), 3, 2, 3, 3))
        rigid[:, :, 0] = -skew(_in_space(self.now))
        rigid[:, :, 1] = np.eye(3)
        return rigid.reshape(-1, 18, 3)

    def projector_rate(self, forces: FloatArray) -> FloatArray:
        """(k, 18, 18) derivative of P^T forces by what the frame sees, at constant (k, 18) ``forces``.

        P^T g = g - mean - spin^T m with the moment m of g about the centroid; both factors depend on the corners.
        """
        nodal = forces.reshape(-1, 3, 2, 3)
        moment = np.einsum("ka,kaj->kj", forces, self._rigid())
        by_seen = np.zeros((len(forces), 3, 3, 6))
        by_seen[..., :3] = -skew(nodal[:, :, 0]).transpose(0, 2, 1, 3)
        rate = -self.spin.transpose(0, 2, 1) @ by_seen.reshape(-1, 3, 18)
        return rate - self._spin_rate(moment)

    def _spin_rate(self, moment: FloatArray) -> FloatArray:
        """(k, 18, 18) derivative of spin^T moment by what the frame sees, at constant (k, 3) ``moment``."""
        rate = np.zeros((len(self.now), 3, 6, 3, 6))
        gradient = shape_gradients(self.now).transpose(0, 2, 1)
        across = moment[:, 0, None] * gradient[:, :, 1] - moment[:, 1, None] * gradient[:, :, 0]
        rate[:, :, 2, :, :2] = -across[:, None, :, None] * gradient[:, :, None, :]
        fitted = np.sum(self.flat * self.now, axis=(1, 2))
        turned = np.stack([-self.flat[:, :, 1], self.flat[:, :, 0]], axis=2)
        turned *= -(moment[:, 2] / fitted**2)[:, None, None]
        rate[:, :, :2, :, :2] = turned[:, :, :, None, None] * self.flat[:, None, None]
        return rate.reshape(-1, 18, 18)

    def to_global(self, vectors: FloatArray) -> FloatArray:
        """(k, 18) vectors of local components turned into global ones."""
        turned: FloatArray = (vectors.reshape(-1, 6, 3) @ self.axes).reshape(-1, 18)
        return turned

    def to_local(self, vectors: FloatArray) -> FloatArray:
        """(k, 18) vectors of global components turned into local ones."""
        turned: FloatArray = (vectors.reshape(-1, 6, 3) @ self.axes.transpose(0, 2, 1)).reshape(-1, 18)
        return turned


def _spin(now: FloatArray, flat: FloatArray) -> FloatArray:
    """(k, 3, 18) turn from displacements of the corners: slopes of the plane, and the best fit within it."""
    spin = np.zeros((len(now), 3, 3, 6))
    gradient = shape_gradients(now)
    spin[:, 0, :, 2] = gradient[:, 1]
    spin[:, 1, :, 2] = -gradient[:, 0]
    fitted = np.sum(flat * now, axis=(1, 2))[:, None]
    spin[:, 2, :, 0] = -flat[:, :, 1] / fitted
    spin[:, 2, :, 1] = flat[:, :, 0] / fitted
    return spin.reshape(-1, 3, 18)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    total: FloatArray = np.sum(a[:, :, 0] * b[:, :, 1] - a[:, :, 1] * b[:, :, 0], axis=1)
    return total


def _in_space(plane: FloatArray) -> FloatArray:
    return np.concatenate([plane, np.zeros((*plane.shape[:2], 1))], axis=2)
