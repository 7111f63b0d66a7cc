"""Shells at large displacements and rotations, strains small: the same elements, carried along by each triangle."""

from services.mechanics.fem.nonlinear.corotational import Configuration, CorotationalShell, largest_strain
from services.mechanics.fem.nonlinear.equilibrium import PathPoint, PathSettings, trace_path
from services.mechanics.fem.nonlinear.loads import NonlinearLoad

__all__ = [
    "Configuration",
    "CorotationalShell",
    "NonlinearLoad",
    "PathPoint",
    "PathSettings",
    "largest_strain",
    "trace_path",
]
