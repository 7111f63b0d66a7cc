"""Natural modes of a shell that is held too little to stand still, or not at all: a plate in the air, a bell.

Its stiffness is singular, so it is pinned: as many dofs more are held as there are rigid motions left. Such supports
bear nothing as long as loads balance, so the pinned shell's flexibility is the floating one's for balanced loads, up to
a rigid motion; taking the rigid part off loads and motions leaves the floating shell's own (Geradin and Rixen,
Mechanical Vibrations, 3rd ed., section 2.10: the statically determinate flexibility, self-equilibrated).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr
from scipy.sparse.linalg import LinearOperator, eigsh

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem.boundary_conditions import RANK_TOLERANCE, rigid_body_modes
from trocar.services.mechanics.fem.modes import EigenModes
from trocar.services.mechanics.fem.shell_model import ShellModel
from trocar.services.mechanics.surface.mesh import TriangleMesh, vertex_components


@dataclass(frozen=True)
class Floating:
    """What a shell's supports leave free to move rigidly.

    Attributes:
        motions: (6 n, k) displacements and rotations of all dofs in each rigid motion, zero at held dofs.
        pins: (k,) dofs 6 * node + component which, held too, would stop just these motions.
    """

    motions: FloatArray
    pins: IntArray


def find_floating(mesh: TriangleMesh, held: IntArray) -> Floating:
    """Return the rigid motions, of each connected piece by itself, that the ``held`` dofs leave."""
    pieces = vertex_components(mesh)
    columns, pins = [], []
    for piece in range(int(pieces.max()) + 1):
        vertices = np.flatnonzero(pieces == piece)
        dofs = (6 * vertices[:, None] + np.arange(6)).ravel()
        positions = mesh.vertices_m[vertices]
        length = float(np.linalg.norm(np.ptp(positions, axis=0)))
        modes = rigid_body_modes(positions, positions.mean(axis=0), length).reshape(-1, 6)
        free = modes @ _null_space(modes[np.isin(dofs, held)])
        if not free.shape[1]:
            continue
        of_all = np.zeros((6 * mesh.n_vertices, free.shape[1]))
        of_all[dofs] = free / np.where(dofs % 6 < 3, 1.0, length)[:, None]
        columns.append(of_all)
        pins.append(dofs[qr(free.T, mode="r", pivoting=True)[1][: free.shape[1]]])
    if not columns:
        return Floating(np.zeros((6 * mesh.n_vertices, 0)), np.zeros(0, np.int32))
    return Floating(np.hstack(columns), np.sort(np.concatenate(pins)).astype(np.int32))


def _null_space(rows: FloatArray) -> FloatArray:
    """(6, k) combinations of the six rigid motions that leave held dofs, one a row, where they are."""
    if not len(rows):
        return np.eye(6)
    _, sizes, combinations = np.linalg.svd(rows, full_matrices=True)
    rank = int((sizes > RANK_TOLERANCE).sum())
    kernel: FloatArray = combinations[rank:].T
    return kernel


def compute_floating_modes(
    pinned: ShellModel, floating: Floating, n_modes: int, on_solve: Callable[[], None] | None = None
) -> EigenModes:
    """Lowest ``n_modes`` of the shell without its pins: the rigid motions at zero, then the elastic ones.

    Raises ValueError if more modes are asked for than the shell has free translations, or the model is ill-conditioned.

    Args:
        pinned: The shell, its supports and the pins held, by elimination.
        floating: The rigid motions, and the pins.
        n_modes, on_solve: As `compute_modes`.
    """
    moves = np.union1d(pinned.free_dofs, floating.pins)
    translations = moves[moves % 6 < 3]
    n, n_rigid = len(translations), floating.motions.shape[1]
    if not 0 < n_modes < n - n_rigid:
        raise ValueError(f"n_modes must lie between 1 and {n - n_rigid - 1}, is {n_modes}")
    pinned.check_condition()
    root_mass = np.sqrt(pinned.mass_kg[translations // 6])
    rigid, scale = np.linalg.qr(root_mass[:, None] * floating.motions[translations])
    motions = floating.motions @ np.linalg.inv(scale)

    def answer(y: FloatArray) -> FloatArray:
        """(6 n,) motion, without its rigid part, under the load root_mass y less what would move the shell rigidly."""
        load, u = np.zeros(pinned.n_dofs), np.zeros(pinned.n_dofs)
        load[translations] = root_mass * (y - rigid @ (rigid.T @ y))
        u[pinned.free_dofs] = pinned.factor.solve(load[pinned.free_dofs])
        moved: FloatArray = u - motions @ (rigid.T @ (root_mass * u[translations]))
        return moved

    def flexibility(y: FloatArray) -> FloatArray:
        if on_solve is not None:
            on_solve()
        moved: FloatArray = root_mass * answer(y.ravel())[translations]
        return moved

    omega, nodal = np.zeros(n_rigid), motions
    if n_modes > n_rigid:
        start = np.random.default_rng(1).standard_normal(n)
        operator = LinearOperator((n, n), matvec=flexibility, dtype=np.float64)
        values, shapes = eigsh(operator, n_modes - n_rigid, which="LM", v0=start)
        order = np.argsort(-values)
        omega = np.concatenate([omega, 1.0 / np.sqrt(values[order])])
        nodal = np.hstack([nodal, *(answer(shapes[:, [k]].ravel())[:, None] / values[k] for k in order)])
    per_node = nodal[:, :n_modes].reshape(-1, 6, n_modes)
    return EigenModes(omega[:n_modes], np.ascontiguousarray(per_node[:, :3]), np.ascontiguousarray(per_node[:, 3:]))
