"""Builds a scene's reduced duct: mesh, section, modes and the rest shape under the effects' constant loads."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.effects import Effect, build_effects, by_stage
from trocar.services.mechanics.effects.wall_term import WallTerm
from trocar.services.mechanics.fem.modes import check_n_modes
from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.reduction.reduce import fetch_residual_displacement, reduce_duct
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.scene.duct_recipe import duct_recipe, wall_section
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.simulation.traction import pulled_recipe
from trocar.services.mechanics.surface.incision import incise
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct


def build_scene_duct(
    scene: SceneModel,
    cache_dir: Path | None = None,
    progress: Progress = ignore_progress,
    mesh: TriangleMesh | None = None,
) -> ReducedDuct:
    """Return the reduced duct of a scene, built or loaded from the cache.

    Every process calls this with the same scene and gets the same duct. Constant loads (weight of the wall,
    insufflation) move the rest shape by the part of their static response that the modes leave out; the modes
    carry the rest of it.
    Raises ValueError: the scene names a file and no mesh was given, or a setting makes no sense.

    Args:
        cache_dir: Path, optional. By default the user's cache.
        progress: callable. Called as ``progress(stage, fraction)``.
        mesh: TriangleMesh, optional. The surface of a scene with ``duct.mesh_file``; such files are read by
            `trocar.services.meshes`.
    """
    mesh = opened_mesh(scene.duct, scene_mesh(scene.duct) if mesh is None else mesh)
    effects = build_effects(scene).values()
    stages = by_stage(effects)
    recipe = _recipe(scene, mesh, effects)
    if scene.duct.traction_n:
        recipe = pulled_recipe(recipe, scene.duct.traction_n, cache_dir, progress)
        mesh = recipe.mesh
    with _about_the_duct():
        duct = reduce_duct(recipe, scene.duct.damping_ratio, cache_dir, progress)
    load = constant_load_n(stages["constant_load_n"], mesh)
    if load is not None and load.any():
        shift = fetch_residual_displacement(recipe, duct, load, cache_dir, progress)
        duct = replace(duct, mesh=TriangleMesh(mesh.vertices_m + shift, mesh.triangles, mesh.vertex_sets))
    for effect in stages["modify_duct"]:
        duct = effect.modify_duct(duct)
    for effect in stages["train"]:
        effect.train(duct, progress)
    return duct


def check_scene_duct(scene: SceneModel, mesh: TriangleMesh | None = None) -> None:
    """Check that the duct can be reduced, in a fraction of the time of reducing it.

    Raises ValueError as `build_scene_duct` does, as far as can be known before the eigenvalues.
    """
    effects = build_effects(scene).values()
    mesh = opened_mesh(scene.duct, scene_mesh(scene.duct) if mesh is None else mesh)
    recipe = _recipe(scene, mesh, effects)
    with _about_the_duct():
        check_n_modes(recipe.model(), recipe.n_modes)
    for effect in effects:
        effect.check_mesh(recipe.mesh)
    if not scene.duct_alone:
        mouth_opening(recipe.mesh)


def check_duct_numbers(duct: DuctScene) -> None:
    """Check that a duct's numbers fit together, without meshing it.

    Raises ValueError that names the scene's part and key.
    """
    try:
        if duct.mesh_file is None:
            duct_geometry(duct)
        wall_section(duct)
        if duct.is_tree:
            duct_tubes(duct)
        if duct.incision is not None:
            duct.incision.incision()
    except ValueError as error:
        if str(error).startswith(("duct.branches", "duct.cystic", "duct.incision")):
            raise
        sentence = str(error).replace("wall_thickness_m", "thickness_m").partition(": ")[2]
        raise ValueError(f"duct: {sentence}") from None


@contextmanager
def _about_the_duct() -> Iterator[None]:
    """Prefix a shell model's error message with the part of the scene it is about."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"duct: {error}") from error


def _recipe(scene: SceneModel, mesh: TriangleMesh, effects: Collection[Effect]) -> DuctRecipe:
    """Return the recipe of the duct: ``effects``, in order, modify the wall's section and may request further modes."""
    section = wall_section(scene.duct, mesh)
    for effect in by_stage(effects)["modify_section"]:
        section = effect.modify_section(section)
    n_local_modes = max((effect.n_local_modes for effect in effects), default=0)
    laws = [effect.stretch_law for effect in effects if isinstance(effect, WallTerm)]
    stretch_law = next((law for law in laws if law is not None), None)
    return replace(duct_recipe(scene.duct, mesh, section), n_local_modes=n_local_modes, stretch_law=stretch_law)


def scene_mesh(duct: DuctScene) -> TriangleMesh:
    """Mesh the parametric duct."""
    if duct.mesh_file is not None:
        raise ValueError(f"duct.mesh_file: {duct.mesh_file} must be read first, pass its mesh")
    if duct.is_tree:
        raise ValueError("duct.branches, or duct.cystic: a branching duct must be meshed first, pass its mesh")
    return parametric_duct(duct_geometry(duct))


def opened_mesh(duct: DuctScene, mesh: TriangleMesh) -> TriangleMesh:
    """Return the mesh with the scene's incision in it, if there is one.

    Raises ValueError that names the key of a value with which this duct cannot be cut.
    """
    if duct.incision is None:
        return mesh
    cut = duct.incision.incision()
    try:
        return incise(mesh, cut)
    except ValueError as error:
        raise ValueError(f"duct.incision.{error}") from None


def duct_geometry(duct: DuctScene) -> DuctGeometry:
    """Return the shape of a parametric duct."""
    return DuctGeometry(
        radius_m=duct.radius_m,
        length_m=duct.length_m,
        n_around=duct.n_around,
        n_along=duct.n_along,
        wall_thickness_m=duct.thickness_m,
        taper=duct.taper,
        curvature_1_m=duct.curvature_1_m,
        cut_angle_rad=duct.cut_angle_rad,
        slit_length_m=duct.slit_length_m,
        slit_width_m=duct.slit_width_m,
    )


def constant_load_n(effects: Iterable[Effect], mesh: TriangleMesh) -> FloatArray | None:
    """Return the sum (n, 3) of the effects' constant loads on the duct's nodes, None without any."""
    loads = [effect.constant_load_n(mesh) for effect in effects]
    return np.sum(loads, axis=0) if loads else None
