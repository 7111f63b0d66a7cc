"""Recipe of a scene's duct: all data that its modes depend on."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ElementChoice, ShellSection, clamp
from trocar.services.mechanics.fem.thinness import bending_of_wall
from trocar.services.mechanics.reduction.recipe import DuctRecipe, ResidualChoice
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.scene.scene_model import DuctScene
from trocar.services.mechanics.surface.mesh import TriangleMesh

MOUTH = "mouth"


def wall_section(duct: DuctScene, mesh: TriangleMesh | None = None) -> ShellSection:
    """Return thickness and material of the wall, the same in every direction and, but for folds, everywhere.

    A fold is solid: its outside is smooth, so on a ``mesh`` the wall is thicker there by as much as the fold is high.
    """
    thickness_m: float | FloatArray = duct.thickness_m
    if mesh is not None and duct.cystic is not None:
        middles_m = mesh.vertices_m[mesh.triangles].mean(axis=1)
        heights_m = np.max([tube.inward_m(middles_m) for tube in duct_tubes(duct)], axis=0)
        thickness_m = thickness_m + heights_m if heights_m.any() else thickness_m
    return ShellSection(thickness_m, duct.youngs_modulus_pa, duct.poisson_ratio, duct.density_kg_m3)


def duct_recipe(duct: DuctScene, mesh: TriangleMesh, section: ShellSection | None = None) -> DuctRecipe:
    """Return the recipe of a duct; ``section`` is `wall_section` unless an effect has modified it."""
    section = section or wall_section(duct, mesh)
    bending = bending_of_wall(mesh, section) if duct.bending == "auto" else duct.bending
    elements = ElementChoice(membrane=duct.membrane, bending=bending)
    residual = ResidualChoice(kind=duct.residual)
    supports = (clamp(mesh),) if duct.traction_n is None else (clamp(mesh), clamp(mesh, MOUTH))
    return DuctRecipe(mesh, section, supports, duct.n_modes, elements, residual)
