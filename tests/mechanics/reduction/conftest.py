import numpy as np
import pytest

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.reduction import ModalBasis, ReducedDuct, Residual
from trocar.services.mechanics.reduction.build import build_basis, fill_full_residual
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

SECTION = ShellSection(0.5e-3, 100e3, 0.45, 1060.0)
N_MODES = 60


@pytest.fixture(scope="session")
def model() -> ShellModel:
    """A duct of 620 nodes, clamped at one end."""
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 20, 30))
    return ShellModel(mesh, SECTION, [clamp(mesh)], ElementChoice("andes", "dkt"))


@pytest.fixture(scope="session")
def basis(model) -> ModalBasis:
    return build_basis(model, N_MODES)


@pytest.fixture(scope="session")
def duct(model, basis) -> ReducedDuct:
    blocks = np.zeros((basis.n_nodes, basis.n_nodes, 3, 3), np.float32)
    fill_full_residual(model, basis, blocks)
    return ReducedDuct(model.mesh, basis, Residual.full(blocks), np.full(N_MODES, 0.05))
