"""Corotational triangles: the linear elements in a frame that each triangle carries along.

Element-independent corotation of Rankin and Nour-Omid (Computers and Structures 23:257, 1986; CMAME 93:353, 1991) in
the form of Felippa and Haugen (CMAME 194:2285, 2005). A triangle's frame turns with its plane, and within the plane by
the best fit of its corners, so that no corner is the first. What remains of displacements and of the nodes' rotations
after that turn is small where the mesh is fine, and the linear stiffness acts on it:

    E = 1/2 sum_e d_e^T K_e d_e,    f = T^T P^T H^T K_e d_e

so the forces are the gradient of an energy at any displacement, and a rigid motion causes none. Strains must be small:
the membrane is linear in the change of length. The tangent is the exact derivative of f.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.assembly import CHUNK, local_stiffness, sum_triangles, turn
from trocar.services.mechanics.fem.frames import local_coordinates, local_frames
from trocar.services.mechanics.fem.nonlinear.carried_frame import CarriedFrame
from trocar.services.mechanics.fem.nonlinear.rotations import (
    exponential,
    logarithm,
    moment_correction,
    skew,
    vector_rate,
)
from trocar.services.mechanics.fem.section import plane_stress_matrices
from trocar.services.mechanics.fem.shell_model import ShellModel


@dataclass(frozen=True)
class Configuration:
    """Where the nodes are and how far each has turned: never changed in place, another one is made instead.

    Attributes:
        position_m: (n, 3).
        rotation: (n, 3, 3) matrices, the identity in the mesh as it was given.
    """

    position_m: FloatArray
    rotation: FloatArray

    @classmethod
    def undeformed(cls, model: ShellModel) -> Configuration:
        """The mesh as it was given."""
        n = model.mesh.n_vertices
        return cls(model.mesh.vertices_m.copy(), np.broadcast_to(np.eye(3), (n, 3, 3)).copy())

    def moved(self, step: FloatArray) -> Configuration:
        """After a (6 n,) step of displacements in m and spins in rad; spins are composed, not added."""
        nodal = step.reshape(-1, 6)
        return Configuration(self.position_m + nodal[:, :3], exponential(nodal[:, 3:]) @ self.rotation)


class CorotationalShell:
    """Energy, forces and tangent of a shell at any configuration.

    Args:
        model: Mesh, section, elements and supports of the linear shell; what was stress-free there is so here.

    Attributes:
        rest_frames: (m, 3, 3) axes of the triangles at rest, in rows.
        flat: (m, 3, 2) corners of the triangles in those axes, from their middle.
    """

    def __init__(self, model: ShellModel) -> None:
        self.model = model
        self.triangles = model.mesh.triangles
        self.rest_frames = local_frames(model.mesh)
        xy = local_coordinates(model.mesh, self.rest_frames)
        D = plane_stress_matrices(model.section, self.rest_frames)
        thickness = model.section.per_triangle("thickness_m", model.mesh.n_triangles)
        parts = _parts(len(xy))
        self._K = np.concatenate([local_stiffness(xy[p], D[p], thickness[p], model.elements) for p in parts])
        self.flat = xy - xy.mean(axis=1, keepdims=True)
        self._last: tuple[Configuration, tuple[slice, _Deformation]] | None = None

    def energy_j(self, at: Configuration) -> float:
        """Strain energy in J."""
        return sum(
            0.5 * float(np.einsum("mi,mij,mj->", state.d, self._K[part], state.d)) for part, state in self._states(at)
        )

    def forces(self, at: Configuration) -> FloatArray:
        """(6 n,) forces in N and moments in N m that hold the shell there: the gradient of the energy."""
        total = np.zeros((self.model.mesh.n_vertices, 6))
        for part, state in self._states(at):
            raw = np.einsum("mij,mj->mi", self._K[part], state.d)
            _, local = state.forces(raw)
            np.add.at(total, self.triangles[part], state.frame.to_global(local).reshape(-1, 3, 6))
        return total.ravel()

    def tangent(self, at: Configuration, carried: FloatArray | None = None) -> bsr_array[np.float64]:
        """(6 n, 6 n) derivative of the forces by displacements and spins.

        Where the forces are not in equilibrium the derivative by spins is not symmetric: rotations do not commute.

        Args:
            at: Where.
            carried: (m, 18) forces that the triangles carry, see `carried_after`; if given, the parts of the tangent
                that are due to force take them instead of the forces there.
        """
        return sum_triangles(self.model.mesh, self._tangents(at, carried))

    def local_tangents(self, part: slice, move: FloatArray) -> FloatArray:
        """(t, 18, 18) tangents of some triangles alone, each in its axes at rest.

        ``move`` (t, 18) is where their corners are from rest: displacements in m and rotation vectors in rad.
        """
        nodal = move.reshape(-1, 3, 2, 3)
        position, at_rest = nodal[:, :, 0].copy(), np.broadcast_to(np.eye(3), (len(move), 3, 3))
        position[:, :, :2] += self.flat[part]
        frame = CarriedFrame.fit(position, self.flat[part])
        state = _Deformation.of(frame, exponential(nodal[:, :, 1]), at_rest)
        K = self._K[part]
        return turn(_local_tangent(K, state, np.einsum("mij,mj->mi", K, state.d)), frame.axes)

    def carried_after(self, at: Configuration, step: FloatArray) -> FloatArray:
        """(m, 18) forces in each triangle's frame that its deformation would cause if a (6 n,) step were small.

        A thin shell that turns in steps is stretched by each of them; what it carries at the end is not that. Newton's
        method with these forces in its tangent is that of the mixed formulation, in which forces are unknowns, and
        takes steps many times as long (Magisano, Leonetti and Garcea, CMAME 313:986, 2017).
        """
        nodal = step.reshape(-1, 6)
        carried = np.empty((len(self.triangles), 18))
        for part, state in self._states(at):
            local = state.frame.to_local(nodal[self.triangles[part]].reshape(-1, 18))
            seen = np.einsum("mij,mj->mi", state.P, local).reshape(-1, 3, 2, 3)
            seen[:, :, 1] = np.einsum("maij,maj->mai", state.H, seen[:, :, 1])
            carried[part] = np.einsum("mij,mj->mi", self._K[part], state.d + seen.reshape(-1, 18))
        return carried

    def _tangents(self, at: Configuration, carried: FloatArray | None) -> Iterator[tuple[slice, FloatArray]]:
        for part, state in self._states(at):
            K = self._K[part]
            raw = np.einsum("mij,mj->mi", K, state.d) if carried is None else carried[part]
            yield part, turn(_local_tangent(K, state, raw), state.frame.axes)

    def _states(self, at: Configuration) -> Iterator[tuple[slice, _Deformation]]:
        """Deform the triangles in parts; of a single part the last is kept, as Newton's method asks thrice for it."""
        if self._last is not None and self._last[0] is at:
            yield self._last[1]
            return
        for found in self._deformed(at):
            if len(self.triangles) <= CHUNK:
                self._last = at, found
            yield found

    def _deformed(self, at: Configuration) -> Iterator[tuple[slice, _Deformation]]:
        for part in _parts(len(self.triangles)):
            corners = self.triangles[part]
            frame = CarriedFrame.fit(at.position_m[corners], self.flat[part])
            yield part, _Deformation.of(frame, at.rotation[corners], self.rest_frames[part])


@dataclass(frozen=True)
class _Deformation:
    """What a triangle's frame sees: (k, 18) deformation d, and the derivatives that lead to it."""

    frame: CarriedFrame
    d: FloatArray
    theta: FloatArray
    H: FloatArray
    P: FloatArray

    @classmethod
    def of(cls, frame: CarriedFrame, rotation: FloatArray, first_frames: FloatArray) -> _Deformation:
        turned = frame.axes[:, None] @ rotation @ first_frames.transpose(0, 2, 1)[:, None]
        theta = logarithm(turned)
        d = np.concatenate([frame.stretched(), theta], axis=2).reshape(-1, 18)
        return cls(frame, d, theta, vector_rate(theta), frame.projector())

    def forces(self, raw: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k, 18) forces by what the frame sees, and by the corners' own motion (P^T), from those by deformation."""
        before = raw.reshape(-1, 3, 2, 3).copy()
        before[:, :, 1] = np.einsum("maji,maj->mai", self.H, before[:, :, 1])
        seen = before.reshape(-1, 18)
        return seen, np.einsum("mji,mj->mi", self.P, seen)


def _local_tangent(K: FloatArray, state: _Deformation, raw: FloatArray) -> FloatArray:
    """(k, 18, 18) derivative of the forces in the frame's axes, the frame's own turn included."""
    H, P, frame = state.H, state.P, state.frame
    before, after = state.forces(raw)
    inner = K.reshape(-1, 3, 2, 3, 18).copy()
    inner[:, :, 1] = np.einsum("maji,majk->maik", H, inner[:, :, 1])
    inner = inner.reshape(-1, 18, 3, 2, 3)
    inner[:, :, :, 1] = np.einsum("mkaj,maji->mkai", inner[:, :, :, 1], H)
    inner = inner.reshape(-1, 3, 2, 3, 3, 2, 3)
    correction = moment_correction(state.theta, raw.reshape(-1, 3, 2, 3)[:, :, 1])
    for a in range(3):
        inner[:, a, 1, :, a, 1] += correction[:, a]
    tangent = P.transpose(0, 2, 1) @ inner.reshape(-1, 18, 18) @ P
    tangent -= skew(after.reshape(-1, 6, 3)).reshape(-1, 18, 3) @ frame.spin
    tangent += frame.projector_rate(before) @ P
    return tangent


def _parts(n: int) -> Iterator[slice]:
    for start in range(0, n, CHUNK):
        yield slice(start, min(start + CHUNK, n))
