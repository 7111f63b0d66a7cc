"""Traction: a duct as it lies while a hand pulls at the neck of the gallbladder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction import cache
from trocar.services.mechanics.reduction.build import Progress
from trocar.services.mechanics.reduction.content_hash import entry_name
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.scene.duct_recipe import MOUTH
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.opening import mouth_opening


def pulled_recipe(recipe: DuctRecipe, traction_n: float, cache_dir: Path | None, progress: Progress) -> DuctRecipe:
    """Return the recipe of a duct, whose mouth is held, after the mouth's rim has been pulled out with ``traction_n``.

    The rim is moved as a whole, straight out of the mouth. The wall is linear, in its shape too: bends are straightened
    and folds flattened to first order, and what is pulled is as stiff as it was.
    """

    def solve(entry: cache.Entry) -> None:
        progress("rest shape", 0.0)
        mesh, rim = recipe.mesh, recipe.mesh.vertex_sets[MOUTH]
        outward = -mouth_opening(mesh).inward
        imposed = np.zeros((mesh.n_vertices, 6))
        imposed[rim, :3] = outward
        solution = recipe.model().solve_static(np.zeros_like(mesh.vertices_m), imposed)
        stiffness_n_m = float(solution.reaction[rim, :3].sum(axis=0) @ outward)
        entry.save("vertices_m", mesh.vertices_m + traction_n / stiffness_n_m * solution.displacement_m)
        entry.describe(stiffness_n_m=stiffness_n_m, kind="pulled")
        progress("rest shape", 1.0)

    name = entry_name("pulled", __name__, recipe.key(), traction_n)
    vertices_m = cache.fetch(cache_dir or cache_directory(), name, solve).load("vertices_m")
    return replace(recipe, mesh=TriangleMesh(vertices_m, recipe.mesh.triangles, recipe.mesh.vertex_sets))
