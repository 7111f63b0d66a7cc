"""Between nodal vectors (n, 3) and vectors over a shell model's free degrees of freedom."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellModel


def free_load(model: ShellModel, forces_n: FloatArray) -> FloatArray:
    """Return nodal forces (n, 3) in N as a load (f,) on the free dofs; rotations are not loaded."""
    nodal = np.zeros((model.mesh.n_vertices, 6))
    nodal[:, :3] = forces_n
    load: FloatArray = nodal.ravel()[model.free_dofs]
    return load


def nodal_translations(model: ShellModel, free: FloatArray) -> FloatArray:
    """Return the translations (n, 3) or (n, 3, c) of a vector (f,) or (f, c) on the free dofs, zero where held."""
    full = np.zeros((model.n_dofs, *free.shape[1:]))
    full[model.free_dofs] = free
    return full.reshape(-1, 6, *free.shape[1:])[:, :3]
