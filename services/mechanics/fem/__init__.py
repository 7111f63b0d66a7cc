"""Thin-shell finite elements: flat triangles, six degrees of freedom a node, linear and sparse."""

from services.mechanics.fem.boundary_conditions import Support, clamp
from services.mechanics.fem.loads import pressure_load
from services.mechanics.fem.modes import EigenModes, compute_modes
from services.mechanics.fem.section import Orthotropy, ShellSection
from services.mechanics.fem.shell_model import ElementChoice, ShellModel, StaticSolution

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
