"""Thin-shell finite elements: flat triangles, six degrees of freedom a node, linear and sparse."""

from trocar.services.mechanics.fem.boundary_conditions import Support, clamp
from trocar.services.mechanics.fem.loads import pressure_load
from trocar.services.mechanics.fem.modes import EigenModes, compute_modes
from trocar.services.mechanics.fem.section import Orthotropy, ShellSection
from trocar.services.mechanics.fem.shell_model import ElementChoice, ShellModel, StaticSolution

__all__ = [
    "EigenModes",
    "ElementChoice",
    "Orthotropy",
    "ShellModel",
    "ShellSection",
    "StaticSolution",
    "Support",
    "clamp",
    "compute_modes",
    "pressure_load",
]
