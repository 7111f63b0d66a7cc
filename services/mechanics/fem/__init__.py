"""Thin-shell finite elements: flat triangles, six degrees of freedom a node, linear and sparse."""

from services.mechanics.fem.buckling import BucklingModes, compute_buckling
from services.mechanics.fem.loads import point_load, pressure_load, surface_load
from services.mechanics.fem.model import ElementChoice, ShellModel, StaticSolution
from services.mechanics.fem.modes import EigenModes, compute_modes
from services.mechanics.fem.section import Orthotropy, ShellSection
from services.mechanics.fem.supports import Support, clamp

__all__ = [
    "BucklingModes",
    "EigenModes",
    "ElementChoice",
    "Orthotropy",
    "ShellModel",
    "ShellSection",
    "StaticSolution",
    "Support",
    "clamp",
    "compute_buckling",
    "compute_modes",
    "point_load",
    "pressure_load",
    "surface_load",
]
