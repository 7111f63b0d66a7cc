"""Modal coordinates that displace the sites, for the second-order response."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.softening.load_sites import LoadSites, Lumen

STIFF_MODES = 0.3
"""How much the energy of a shape counts beside its fit: the median mode's against the mean mode's displacement."""


def delivery(duct: ReducedDuct, sites: LoadSites, lumen: Lumen) -> FloatArray:
    """(r, m) modal coordinates that move the sites inward by nearly a unit each, at little energy.

    Modes beside supports are not among them.
    """
    basis, mesh = duct.basis, duct.mesh
    lowest = slice(basis.n_modes - duct.n_local_modes)
    rows = np.einsum("nar,na->nr", basis.Phi[:, :, lowest], lumen.inward)
    weights = np.einsum("nka,na->nk", sites.weights, lumen.inward)
    total = weights.sum(axis=1, keepdims=True)
    weights = np.where(total > 0.0, weights / np.where(total > 0.0, total, 1.0), 0.0)
    wanted = np.zeros((mesh.n_vertices, len(sites.nodes)))
    np.put_along_axis(wanted, sites.near.astype(np.intp), weights, axis=1)
    normal, stiffness = rows.T @ rows, basis.omega_rad_s[lowest] ** 2
    # High modes fit the last per cent of a shape and store more energy in it than in all the rest.
    costly = STIFF_MODES * np.trace(normal) / len(normal) * stiffness / np.median(stiffness)
    normal[np.diag_indices_from(normal)] += costly
    modal = np.zeros((basis.n_modes, len(sites.nodes)))
    modal[lowest] = np.linalg.solve(normal, rows.T @ wanted)
    return modal
