"""Modal reduction of the duct: basis, residual compliance, integrators, cache, and the nonlinear extensions."""

from services.mechanics.reduction.basis import ModalBasis
from services.mechanics.reduction.cache import CacheError
from services.mechanics.reduction.modal_state import ModalGains, ModalIntegrator, ModalState
from services.mechanics.reduction.newmark import Newmark
from services.mechanics.reduction.oscillator import ExactOscillator
from services.mechanics.reduction.recipe import DuctRecipe, ResidualChoice
from services.mechanics.reduction.reduce import reduce_duct
from services.mechanics.reduction.reduced_duct import ReducedDuct
from services.mechanics.reduction.residual.blocks import Residual

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
    "reduce_duct",
]
