"""Modes by the paper's dense condensation: the reference of the sparse ones, for small meshes."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.fem.modes import EigenModes, expand_to_nodes


def condensed_stiffness(model: ShellModel) -> FloatArray:
    """Dense stiffness over the free translations, K_tt - K_tr K_rr⁻¹ K_rt (paper eq. 16)."""
    t = model.free_translations
    r = np.setdiff1d(np.arange(len(model.free_dofs)), t)
    K = model.K_free.toarray()
    K_tr = K[np.ix_(t, r)]
    condensed: FloatArray = K[np.ix_(t, t)] - K_tr @ cho_solve(cho_factor(K[np.ix_(r, r)]), K_tr.T)
    return 0.5 * (condensed + condensed.T)


def compute_modes_dense(model: ShellModel, n_modes: int) -> EigenModes:
    """The same modes by the paper's dense condensation: O(n²) memory, O(n³) time."""
    mass = model.free_mass_kg[model.free_translations]
    values, vectors = eigh(condensed_stiffness(model), np.diag(mass), subset_by_index=[0, n_modes - 1])
    return expand_to_nodes(model, np.sqrt(values), vectors)
