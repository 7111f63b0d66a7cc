"""Modal reduction of the duct: basis, residual compliance, integrators, cache, and the nonlinear extensions."""

from services.mechanics.reduction.basis import ModalBasis
from services.mechanics.reduction.cache import CacheError
from services.mechanics.reduction.duct import ReducedDuct, rayleigh_damping_ratio
from services.mechanics.reduction.newmark import Newmark
from services.mechanics.reduction.oscillator import ExactOscillator
from services.mechanics.reduction.recipe import DuctRecipe, ResidualChoice
from services.mechanics.reduction.reduce import find_basis, reduce_duct
from services.mechanics.reduction.residual.blocks import Residual
from services.mechanics.reduction.state import ModalGains, ModalIntegrator, ModalState, correct, modal_reaction

__all__ = [
    "CacheError",
    "DuctRecipe",
    "ExactOscillator",
    "ModalBasis",
    "ModalGains",
    "ModalIntegrator",
    "ModalState",
    "Newmark",
    "ReducedDuct",
    "Residual",
    "ResidualChoice",
    "correct",
    "find_basis",
    "modal_reaction",
    "rayleigh_damping_ratio",
    "reduce_duct",
]
