"""A small reduced duct with made-up modes: what the view does with it does not depend on where they came from."""

import numpy as np

from trocar.services.mechanics.reduction import ModalBasis, ReducedDuct, Residual
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

MODES = 5


def make_duct() -> ReducedDuct:
    """Return a duct of 35 nodes with random modes and a random symmetric residual."""
    mesh = parametric_duct(DuctGeometry(radius_m=4e-3, length_m=40e-3, n_around=7, n_along=4))
    n = mesh.n_vertices
    random = np.random.default_rng(7)
    basis = ModalBasis.from_modes(np.arange(1.0, MODES + 1), random.normal(size=(n, 3, MODES)))
    flat = random.normal(size=(3 * n, 3 * n)) * 1e-3
    blocks = (flat + flat.T).reshape(n, 3, n, 3).transpose(0, 2, 1, 3)
    return ReducedDuct(mesh, basis, Residual.full(np.ascontiguousarray(blocks)), np.full(MODES, 0.1))
