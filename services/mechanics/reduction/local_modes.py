"""Modes beside supports, by residual vectors.

On the first row of nodes beside a clamp the lowest 80 modes hold a quarter of what a force moves the wall by. The
responses to forces on the nodes there are made modes (`residual_vectors`).
"""

from __future__ import annotations

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.residual_vectors import ALIKE, add_residual_vectors
from trocar.services.mechanics.reduction.softening.load_sites import lumen_width_m
from trocar.services.mechanics.surface.mesh import vertex_normals

REACH_WIDTHS = 0.5
"""Of the lumen: nodes so near a support are loaded."""
N_WIDTHS = 32
"""Nodes from which the lumen's width is taken."""


def with_local_modes(model: ShellModel, basis: ModalBasis, n_most: int) -> tuple[ModalBasis, int]:
    """Add up to ``n_most`` modes beside supports.

    They come last; also returned is how many they are.
    """
    nodes, inward = _beside_supports(model)
    loads = np.zeros((len(nodes), model.mesh.n_vertices, 3))
    loads[np.arange(len(nodes)), nodes] = inward
    return add_residual_vectors(model, basis, loads, n_most)


def _beside_supports(model: ShellModel) -> tuple[IntArray, FloatArray]:
    """Nodes (k,) beside supports, and unit forces (k, 3) inward on them."""
    mesh = model.mesh
    held = np.unique(model.held_dofs // 6)
    far = np.asarray(scipy.spatial.cKDTree(mesh.vertices_m[held]).query(mesh.vertices_m)[0])
    inward = -vertex_normals(mesh)
    nearest = np.setdiff1d(np.argsort(far, kind="stable")[: len(held) + N_WIDTHS], held)
    reach = REACH_WIDTHS * lumen_width_m(mesh, nearest, inward)
    nodes = np.setdiff1d(np.flatnonzero(far <= max(reach, far[nearest].min()) * (1.0 + ALIKE)), held).astype(np.int32)
    return nodes, inward[nodes]
