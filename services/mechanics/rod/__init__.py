"""The catheter: a chain of particles with stretch, bending, twist and damping, and its integrators."""

from trocar.services.mechanics.rod.energy import RodEnergy, rod_energy
from trocar.services.mechanics.rod.implicit import ImplicitIntegrator
from trocar.services.mechanics.rod.integrator import RodIntegrator, build_integrator
from trocar.services.mechanics.rod.material_frame import MaterialFrame, initial_frame, roll
from trocar.services.mechanics.rod.properties import RodProperties, RoundTube
from trocar.services.mechanics.rod.semi_implicit import SemiImplicitIntegrator
from trocar.services.mechanics.rod.state import RodState, rod_along, straight_rod
from trocar.services.mechanics.rod.supports import Introducer, Supports, clamped

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
    "straight_rod",
]
