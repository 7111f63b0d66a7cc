"""The catheter: a chain of particles with stretch, bending, twist and damping, and its integrators."""

from .energy import RodEnergy, rod_energy
from .implicit import ImplicitIntegrator
from .integrator import RodIntegrator, build_integrator
from .material_frame import MaterialFrame, initial_frame, roll
from .properties import RodProperties, RoundTube
from .semi_implicit import SemiImplicitIntegrator
from .spline import smooth_centreline
from .state import RodState, rod_along, straight_rod
from .supports import Introducer, Supports, clamped

__all__ = [
    "ImplicitIntegrator",
    "Introducer",
    "MaterialFrame",
    "RodEnergy",
    "RodIntegrator",
    "RodProperties",
    "RodState",
    "RoundTube",
    "SemiImplicitIntegrator",
    "Supports",
    "build_integrator",
    "clamped",
    "initial_frame",
    "rod_along",
    "rod_energy",
    "roll",
    "smooth_centreline",
    "straight_rod",
]
