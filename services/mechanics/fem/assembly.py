"""Element matrices in global axes and their sparse sum (paper eq. 5 to 14)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.elements import BENDING_ELEMENTS, MEMBRANE_ELEMENTS, choose
from trocar.services.mechanics.fem.frames import local_coordinates, local_frames
from trocar.services.mechanics.fem.section import ShellSection, plane_stress_matrices
from trocar.services.mechanics.fem.triangle import signed_areas
from trocar.services.mechanics.surface.mesh import TriangleMesh

MEMBRANE_DOFS = np.array([0, 1, 5, 6, 7, 11, 12, 13, 17])
BENDING_DOFS = np.array([2, 3, 4, 8, 9, 10, 14, 15, 16])
"""Where the nine dofs of each part lie among the 18 local ones (u, v, w, theta_x, theta_y, theta_z per node)."""

CHUNK = 8192
"""Triangles whose 18 x 18 matrices exist at the same time: so many that they take 21 MB, whatever the mesh."""


@dataclass(frozen=True)
class ElementChoice:
    """Which triangle carries the membrane and which the bending part: names in the tables of ``fem.elements``."""

    membrane: str = "cst"
    bending: str = "dkt"


def element_stiffness(
    xy: FloatArray, frames: FloatArray, D: FloatArray, thickness: FloatArray, choice: ElementChoice
) -> FloatArray:
    """(m, 18, 18) stiffness in global axes; dofs (ux, uy, uz, rx, ry, rz) of each corner in turn."""
    return to_global_axes(local_stiffness(xy, D, thickness, choice), frames)


def local_stiffness(xy: FloatArray, D: FloatArray, thickness: FloatArray, choice: ElementChoice) -> FloatArray:
    """(m, 18, 18) stiffness in each triangle's own axes; dofs (u, v, w, theta_x, theta_y, theta_z) of each corner.

    Membrane and bending are uncoupled within a flat triangle; they couple where triangles meet at an angle.
    """
    membrane = choose(MEMBRANE_ELEMENTS, choice.membrane, "membrane")
    bending = choose(BENDING_ELEMENTS, choice.bending, "bending")
    K = np.zeros((len(xy), 18, 18))
    K[:, MEMBRANE_DOFS[:, None], MEMBRANE_DOFS] = membrane.stiffness(xy, D, thickness)
    K[:, BENDING_DOFS[:, None], BENDING_DOFS] = bending.stiffness(xy, D, thickness)
    return K


def to_global_axes(K: FloatArray, frames: FloatArray) -> FloatArray:
    """(m, 18, 18) matrices of local dofs turned into global axes and made exactly symmetric."""
    K = turn(K, frames)
    symmetric: FloatArray = 0.5 * (K + K.transpose(0, 2, 1))
    return symmetric


def turn(K: FloatArray, frames: FloatArray) -> FloatArray:
    """(m, 18, 18) matrices of local dofs turned into global axes."""
    turned = K.reshape(-1, 18, 6, 3) @ frames[:, None]
    turned = frames[:, None].transpose(0, 1, 3, 2) @ turned.reshape(-1, 6, 3, 18)
    result: FloatArray = turned.reshape(-1, 18, 18)
    return result


def assemble_stiffness(
    mesh: TriangleMesh, section: ShellSection, choice: ElementChoice
) -> scipy.sparse.bsr_array[np.float64]:
    """(6 n, 6 n) stiffness in 6 x 6 blocks, one a pair of connected nodes; exactly symmetric."""
    return sum_triangles(mesh, element_chunks(mesh, section, choice))


def sum_triangles(mesh: TriangleMesh, chunks: Iterable[tuple[slice, FloatArray]]) -> scipy.sparse.bsr_array[np.float64]:
    """(6 n, 6 n) sum of (k, 18, 18) matrices, given in slices of the triangles.

    The pattern is found once from node pairs and every entry is summed into place, so the memory above the result
    is one chunk of element matrices.
    """
    n = mesh.n_vertices
    pairs = mesh.triangles.astype(np.int64)[:, :, None] * n + mesh.triangles[:, None, :]
    keys, slots = np.unique(pairs.ravel(), return_inverse=True)
    slots = slots.reshape(-1, 9)
    blocks = np.zeros((len(keys), 36))
    for chunk, K in chunks:
        _add_blocks(blocks, slots[chunk].ravel(), K.reshape(-1, 3, 6, 3, 6).transpose(0, 1, 3, 2, 4))
    rows, columns = np.divmod(keys, n)
    row_start = np.searchsorted(rows, np.arange(n + 1)).astype(np.int32)
    data = blocks.reshape(-1, 6, 6)
    return scipy.sparse.bsr_array((data, columns.astype(np.int32), row_start), shape=(6 * n, 6 * n))


def _add_blocks(blocks: FloatArray, slots: FloatArray, contributions: FloatArray) -> None:
    """Add (k, 36) contributions to the rows of ``blocks`` that ``slots`` names, in order, so that sums repeat."""
    order = np.argsort(slots, kind="stable")
    sorted_slots = slots[order]
    starts = np.flatnonzero(np.diff(sorted_slots, prepend=-1))
    values = contributions.reshape(-1, 36)[order]
    blocks[sorted_slots[starts]] += np.add.reduceat(values, starts, axis=0)


def element_chunks(
    mesh: TriangleMesh, section: ShellSection, choice: ElementChoice
) -> Iterator[tuple[slice, FloatArray]]:
    """Slices of the triangles, each with its (k, 18, 18) stiffness in global axes."""
    frames = local_frames(mesh)
    xy = local_coordinates(mesh, frames)
    D = plane_stress_matrices(section, frames)
    thickness = section.per_triangle("thickness_m", mesh.n_triangles)
    for start in range(0, mesh.n_triangles, CHUNK):
        chunk = slice(start, start + CHUNK)
        yield chunk, element_stiffness(xy[chunk], frames[chunk], D[chunk], thickness[chunk], choice)


def assemble_lumped_mass(mesh: TriangleMesh, section: ShellSection) -> FloatArray:
    """(n,) translational mass of each node in kg, a third of each triangle's; rotations carry none."""
    frames = local_frames(mesh)
    per_area = section.per_triangle("density_kg_m3", mesh.n_triangles) * section.per_triangle(
        "thickness_m", mesh.n_triangles
    )
    third = per_area * signed_areas(local_coordinates(mesh, frames)) / 3.0
    mass = np.zeros(mesh.n_vertices)
    np.add.at(mass, mesh.triangles, third[:, None])
    return mass
