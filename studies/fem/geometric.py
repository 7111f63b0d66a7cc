"""Geometric stiffness of membrane stress, and the load stiffness of a pressure that follows the wall."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import bsr_array

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.assembly import BENDING_DOFS, CHUNK, MEMBRANE_DOFS, sum_triangles, to_global_axes
from trocar.services.mechanics.fem.elements import MEMBRANE_ELEMENTS, choose
from trocar.services.mechanics.fem.elements.dkt import normal_rotations
from trocar.services.mechanics.fem.frames import local_coordinates, local_frames
from trocar.services.mechanics.fem.nonlinear.follower_loads import pressure_chunks
from trocar.services.mechanics.fem.section import plane_stress_matrices
from trocar.services.mechanics.fem.shell_model import ShellModel, StaticSolution
from trocar.services.mechanics.fem.triangle import shape_gradients, signed_areas

# Means over a triangle of the products of its six quadratic shape functions: corners, then mid-sides 12, 23, 31.
QUADRATIC_PRODUCTS = (
    np.array(
        [
            [6, -1, -1, 0, -4, 0],
            [-1, 6, -1, 0, 0, -4],
            [-1, -1, 6, -4, 0, 0],
            [0, 0, -4, 32, 16, 16],
            [-4, 0, 0, 16, 32, 16],
            [0, -4, 0, 16, 16, 32],
        ]
    )
    / 180.0
)
IN_PLANE = np.array([[0, 6, 12], [1, 7, 13]])
"""Dofs u and v of the three corners among a triangle's 18."""


def membrane_forces(model: ShellModel, solution: StaticSolution) -> FloatArray:
    """(m, 3) mean forces per length (xx, yy, xy) in N/m in each triangle's local frame.

    They are what does the work of the triangle's own nodal forces in any constant strain, which holds for every
    membrane element alike and is exact where the strain is constant.
    """
    mesh = model.mesh
    frames = local_frames(mesh)
    xy = local_coordinates(mesh, frames)
    D = plane_stress_matrices(model.section, frames)
    thickness = model.section.per_triangle("thickness_m", mesh.n_triangles)
    nodal = np.stack([solution.displacement_m, solution.rotation_rad], axis=1)[mesh.triangles]
    local = (nodal @ frames[:, None].transpose(0, 1, 3, 2)).reshape(-1, 18)[:, MEMBRANE_DOFS]
    stiffness = choose(MEMBRANE_ELEMENTS, model.elements.membrane, "membrane").stiffness
    forces = np.empty((mesh.n_triangles, 3))
    for start in range(0, mesh.n_triangles, CHUNK):
        part = slice(start, start + CHUNK)
        nodal_forces = stiffness(xy[part], D[part], thickness[part]) @ local[part, :, None]
        work = _constant_strains(xy[part]).transpose(0, 2, 1) @ nodal_forces
        forces[part] = work[..., 0] / signed_areas(xy[part])[:, None]
    return forces


def _constant_strains(xy: FloatArray) -> FloatArray:
    """(m, 9, 3) nodal (u, v, theta_z) of unit strains xx, yy and engineering xy."""
    x, y = (xy - xy.mean(axis=1, keepdims=True)).transpose(2, 0, 1)
    states = np.zeros((len(xy), 9, 3))
    states[:, 0::3, 0] = x
    states[:, 1::3, 1] = y
    states[:, 0::3, 2], states[:, 1::3, 2] = 0.5 * y, 0.5 * x
    return states


def geometric_stiffness(model: ShellModel, forces: FloatArray) -> bsr_array[np.float64]:
    """(6 n, 6 n) stiffness of membrane forces (m, 3): the integral of grad u_i . N grad u_i over all directions i.

    In the plane displacements are linear. Across it the slopes are the quadratic ones of the discrete Kirchhoff
    triangle, whichever element bends, so that load factors of plates converge as its deflections do.
    """
    return sum_triangles(model.mesh, _geometric_chunks(model, forces))


def _geometric_chunks(model: ShellModel, forces: FloatArray) -> Iterator[tuple[slice, FloatArray]]:
    frames = local_frames(model.mesh)
    xy = local_coordinates(model.mesh, frames)
    N = forces[:, [[0, 2], [2, 1]]]
    for start in range(0, len(xy), CHUNK):
        part = slice(start, start + CHUNK)
        area = signed_areas(xy[part])[:, None, None]
        K = np.zeros((len(area), 18, 18))
        gradient = shape_gradients(xy[part])
        in_plane = area * (gradient.transpose(0, 2, 1) @ N[part] @ gradient)
        for dofs in IN_PLANE:
            K[:, dofs[:, None], dofs] = in_plane
        slopes = normal_rotations(xy[part])
        weighted = np.einsum("ab,mbid->maid", QUADRATIC_PRODUCTS, N[part, None] @ slopes)
        K[:, BENDING_DOFS[:, None], BENDING_DOFS] = area * np.einsum("maie,maid->med", slopes, weighted)
        yield part, to_global_axes(K, frames[part])


def pressure_stiffness(model: ShellModel, pressure_pa: float) -> bsr_array[np.float64]:
    """(6 n, 6 n) stiffness of a pressure inside that stays normal to the wall, its symmetric part.

    The rest belongs to the work at open rims that can move; on a closed surface, or one whose rims are held, there is
    none (Hibbitt, IJNME 14:937, 1979; Schweizerhof and Ramm, Computers and Structures 18:1099, 1984).
    """
    chunks = pressure_chunks(model.mesh, pressure_pa)
    return sum_triangles(model.mesh, ((part, 0.5 * (K + K.transpose(0, 2, 1))) for part, K in chunks))
