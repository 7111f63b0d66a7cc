"""A scene in motion: the step of everything together, the scene's duct, the energy balance."""

from trocar.services.mechanics.simulation.simulation import Simulation

__all__ = ["Simulation"]
