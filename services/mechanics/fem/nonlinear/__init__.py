"""Shells at large displacements and rotations, strains small: the same elements, carried along by each triangle."""

from trocar.services.mechanics.fem.nonlinear.corotational import Configuration, CorotationalShell
from trocar.services.mechanics.fem.nonlinear.equilibrium import PathPoint, PathSettings, trace_path
from trocar.services.mechanics.fem.nonlinear.follower_loads import NonlinearLoad

__all__ = [
    "Configuration",
    "CorotationalShell",
    "NonlinearLoad",
    "PathPoint",
    "PathSettings",
    "trace_path",
]
