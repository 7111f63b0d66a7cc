"""Modal reduction of the duct: basis, residual compliance, integrators, cache, and the nonlinear extensions."""

from services.mechanics.reduction.basis import ModalBasis
from services.mechanics.reduction.duct import ReducedDuct, rayleigh_damping_ratio
from services.mechanics.reduction.newmark import Newmark
from services.mechanics.reduction.oscillator import ExactOscillator
from services.mechanics.reduction.residual import FullResidual, NoResidual, Residual
from services.mechanics.reduction.state import ModalGains, ModalIntegrator, ModalState, correct

__all__ = [
    "ExactOscillator",
    "FullResidual",
    "ModalBasis",
    "ModalGains",
    "ModalIntegrator",
    "ModalState",
    "Newmark",
    "NoResidual",
    "ReducedDuct",
    "Residual",
    "correct",
    "rayleigh_damping_ratio",
]
