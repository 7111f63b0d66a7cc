"""Modal reduction of the duct: basis, residual compliance, integrators, cache, and the nonlinear extensions."""

from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.cache import CacheError
from trocar.services.mechanics.reduction.modal_state import ModalGains, ModalIntegrator, ModalState
from trocar.services.mechanics.reduction.newmark import Newmark
from trocar.services.mechanics.reduction.oscillator import ExactOscillator
from trocar.services.mechanics.reduction.recipe import DuctRecipe, ResidualChoice
from trocar.services.mechanics.reduction.reduce import reduce_duct
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.residual.blocks import Residual

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
