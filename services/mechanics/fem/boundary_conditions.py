"""Supports: which degrees of freedom they hold, and whether every piece is kept from moving rigidly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, vertex_components

DOF_NAMES = ("ux", "uy", "uz", "rx", "ry", "rz")
"""Translations and rotations in global axes, in the order of the six dofs of a node."""
RANK_TOLERANCE = 1e-6
"""Of held dofs' motions in the rigid ones, lengths in the size of the piece: what is less holds nothing."""


@dataclass(frozen=True)
class Support:
    """Vertices whose named degrees of freedom are held."""

    vertices: IntArray
    dofs: tuple[str, ...] = DOF_NAMES


def clamp(mesh: TriangleMesh, vertex_set: str = "clamped") -> Support:
    """Hold all six degrees of freedom of a named vertex set.

    Raises ValueError if the mesh has no such set; the message lists those it has.
    """
    if vertex_set not in mesh.vertex_sets:
        known = ", ".join(mesh.vertex_sets) or "none"
        raise ValueError(f"mesh has no vertex set '{vertex_set}'; it has: {known}")
    return Support(mesh.vertex_sets[vertex_set])


def held_dofs(mesh: TriangleMesh, supports: Sequence[Support]) -> IntArray:
    """Sorted indices 6 * node + component of every held dof."""
    held = np.zeros((mesh.n_vertices, 6), bool)
    for support in supports:
        unknown = [name for name in support.dofs if name not in DOF_NAMES]
        if unknown:
            raise ValueError(f"support: unknown dof '{unknown[0]}'; known: {', '.join(DOF_NAMES)}")
        vertices = np.asarray(support.vertices)
        strange = vertices[(vertices < 0) | (vertices >= mesh.n_vertices)]
        if len(strange):
            raise ValueError(f"support: vertex {strange[0]} does not exist, there are {mesh.n_vertices}")
        for name in support.dofs:
            held[vertices, DOF_NAMES.index(name)] = True
    return np.flatnonzero(held).astype(np.int32)


def rigid_body_modes(positions_m: FloatArray, origin_m: FloatArray, length_m: float = 1.0) -> FloatArray:
    """(n, 6, 6) displacement and rotation of nodes in three unit translations and three unit turns.

    Turns go about axes through ``origin_m``; rotations are scaled by ``length_m`` so that columns compare.
    """
    modes = np.zeros((len(positions_m), 6, 6))
    modes[:, :3, :3] = np.eye(3)
    arm = (positions_m - origin_m) / length_m
    for k in range(3):
        modes[:, :3, 3 + k] = np.cross(np.eye(3)[k], arm)
    modes[:, 3:, 3:] = np.eye(3)
    return modes


def check_supported(mesh: TriangleMesh, held: IntArray) -> None:
    """Refuse a mesh with an unused vertex or a piece that can still move rigidly.

    Raises ValueError that names the piece, where it is, and in how many ways it is free.
    """
    used = np.zeros(mesh.n_vertices, bool)
    used[mesh.triangles] = True
    if not used.all():
        raise ValueError(f"mesh: vertex {int(np.flatnonzero(~used)[0])} belongs to no triangle")
    pieces = vertex_components(mesh)
    piece_of_held = pieces[held // 6]
    for piece in range(int(pieces.max()) + 1):
        vertices = np.flatnonzero(pieces == piece)
        freedom = _rigid_freedom(mesh.vertices_m[vertices], mesh.vertices_m, held[piece_of_held == piece])
        if freedom:
            centre_mm = np.round(1e3 * mesh.vertices_m[vertices].mean(axis=0), 2).tolist()
            raise ValueError(
                f"supports: the piece of {len(vertices)} vertices round {centre_mm} mm is not held: it can still "
                f"move rigidly in {freedom} of 6 ways"
            )


def _rigid_freedom(piece_m: FloatArray, all_m: FloatArray, held: IntArray) -> int:
    centre = piece_m.mean(axis=0)
    length = float(np.linalg.norm(np.ptp(piece_m, axis=0)))
    modes = rigid_body_modes(all_m[held // 6], centre, length)
    rows = modes[np.arange(len(held)), held % 6]
    return 6 - int(np.linalg.matrix_rank(rows, tol=RANK_TOLERANCE)) if len(held) else 6
