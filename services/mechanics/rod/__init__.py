"""The catheter: a chain of particles with stretch, bending, twist and damping, and its integrators."""

from .implicit import ImplicitIntegrator
from .properties import RodProperties, RoundTube
from .state import RodState, rod_along, straight_rod
from .supports import Sleeve, Supports, clamped

__all__ = [
    "ImplicitIntegrator",
    "RodProperties",
    "RodState",
    "RoundTube",
    "Sleeve",
    "Supports",
    "clamped",
    "rod_along",
    "straight_rod",
]
