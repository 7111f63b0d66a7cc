"""Recipe of a scene's duct: all data that its modes depend on."""

from __future__ import annotations

from trocar.services.mechanics.fem import ElementChoice, ShellSection, clamp
from trocar.services.mechanics.fem.thinness import bending_of_wall
from trocar.services.mechanics.reduction.recipe import DuctRecipe, ResidualChoice
from trocar.services.mechanics.scene.scene_model import DuctScene
from trocar.services.mechanics.surface.mesh import TriangleMesh


def wall_section(duct: DuctScene) -> ShellSection:
    """Return thickness and material of the wall, the same everywhere and in every direction."""
    return ShellSection(duct.thickness_m, duct.youngs_modulus_pa, duct.poisson_ratio, duct.density_kg_m3)


def duct_recipe(duct: DuctScene, mesh: TriangleMesh, section: ShellSection | None = None) -> DuctRecipe:
    """Return the recipe of a duct; ``section`` is `wall_section` unless an effect has modified it."""
    section = section or wall_section(duct)
    bending = bending_of_wall(mesh, section) if duct.bending == "auto" else duct.bending
    elements = ElementChoice(membrane=duct.membrane, bending=bending)
    residual = ResidualChoice(kind=duct.residual)
    return DuctRecipe(mesh, section, (clamp(mesh),), duct.n_modes, elements, residual)
