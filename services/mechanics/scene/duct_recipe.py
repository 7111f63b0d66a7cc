"""What decides the modes of a scene's duct."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from services.mechanics.fem import ElementChoice, Orthotropy, ShellSection, clamp
from services.mechanics.reduction.recipe import DuctRecipe, ResidualChoice
from services.mechanics.scene import DuctScene
from services.mechanics.surface.mesh import TriangleMesh

if TYPE_CHECKING:  # the effect of the nonlinear membrane needs this module
    from services.mechanics.effects.base import Effect


def duct_recipe(duct: DuctScene, mesh: TriangleMesh, effects: Mapping[str, Effect]) -> DuctRecipe:
    """Collect section, supports, elements and number of modes; the effect ``anisotropy`` changes the section."""
    anisotropy = effects.get("anisotropy")
    poisson_ratio = duct.poisson_ratio if anisotropy is None else anisotropy.settings.poisson_ratio
    section = ShellSection(
        duct.thickness_m, duct.youngs_modulus_pa, poisson_ratio, duct.density_kg_m3, _orthotropy(anisotropy)
    )
    elements = ElementChoice(membrane=duct.membrane, bending=duct.bending)
    residual = ResidualChoice(kind=duct.residual)
    return DuctRecipe(mesh, section, (clamp(mesh),), duct.n_modes, elements, residual)


def _orthotropy(effect: Effect | None) -> Orthotropy | None:
    if effect is None:
        return None
    settings = effect.settings
    return Orthotropy(np.array(settings.axis), settings.modulus_ratio, settings.shear_modulus_ratio)
