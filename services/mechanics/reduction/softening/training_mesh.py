"""Mesh on which the softening law is trained: a coarser one of the same duct where the duct has many nodes.

The law relates excess work to cubic energy. Both are without dimension and converge on a coarse mesh long before the
displacements do, so the law of a few hundred nodes serves any finer mesh.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellSection, Support
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.surface.coarsening import coarsened
from trocar.services.mechanics.surface.mesh import TriangleMesh

FINE_NODES_MAX = 640
"""Of a wall that is followed as it is: 48 squeezes of it take 50 s."""
COARSE_NODES = 320


def has_few_nodes(recipe: DuctRecipe) -> bool:
    """Whether a wall is followed as it is."""
    return recipe.mesh.n_vertices <= FINE_NODES_MAX


def training_recipe(recipe: DuctRecipe) -> DuctRecipe:
    """Return the recipe of the wall to squeeze, its own where that is small or cannot be had on fewer nodes."""
    if has_few_nodes(recipe):
        return recipe
    try:
        mesh, kept = coarsened(recipe.mesh, COARSE_NODES)
    except ValueError:
        return recipe
    place = np.full(recipe.mesh.n_vertices, -1, np.int32)
    place[kept] = np.arange(len(kept), dtype=np.int32)
    supports = tuple(Support(_kept(place, support.vertices), support.dofs) for support in recipe.supports)
    if any(len(support.vertices) == 0 for support in supports):
        return recipe
    return replace(recipe, mesh=mesh, section=_section_on(mesh, recipe), supports=supports)


def _kept(place: IntArray, vertices: IntArray) -> IntArray:
    there: IntArray = place[vertices]
    return there[there >= 0]


def _section_on(mesh: TriangleMesh, recipe: DuctRecipe) -> ShellSection:
    """Take what is given per triangle from the triangle that is nearest."""
    own, section = recipe.mesh, recipe.section
    middles = [each.vertices_m[each.triangles].mean(axis=1) for each in (own, mesh)]
    nearest = scipy.spatial.cKDTree(middles[0]).query(middles[1])[1]

    def there(value: float | FloatArray, n_axes: int = 0) -> float | FloatArray:
        return np.asarray(value)[nearest] if np.ndim(value) > n_axes else value

    names = ("thickness_m", "youngs_modulus_pa", "poisson_ratio", "density_kg_m3")
    orthotropy = section.orthotropy
    if orthotropy is not None:
        orthotropy = replace(orthotropy, axis=np.asarray(there(orthotropy.axis, n_axes=1)))
    return replace(section, **{name: there(getattr(section, name)) for name in names}, orthotropy=orthotropy)
