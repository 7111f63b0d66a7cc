"""What processes share of a scene: the reduced duct, with the mesh read where the scene names a file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct, check_scene_duct, opened_mesh, scene_mesh
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.runtime.errors import ConfigError, MissingPackageError
from trocar.services.start.start_progress import StartProgress


def check_duct(scene: SceneModel, cache: Path) -> None:
    """Refuse what `load_duct` would refuse, without computing modes.

    Raises ConfigError if the mesh or the settings of the duct cannot be used.
    """
    with _one_sentence(scene):
        check_scene_duct(scene, _file_mesh(scene.duct, cache, ignore_progress))


#: Stages that every duct goes through when it is built, in their order, with their share of the time.
_STAGES = {
    "surface": 0.01, "assembly": 0.02, "factorisation": 0.03, "modes": 0.64, "residual compliance": 0.28,
    "exact near field": 0.02,
}  # fmt: skip


def load_duct(scene: SceneModel, cache: Path, progress: Progress) -> ReducedDuct:
    """Return the duct of `scene`, from the cache where it is there: every process gets the same.

    Meanwhile the linear algebra of this process has one thread: with another number of them sums are rounded
    otherwise, and the cache would hold another basis under the same key.
    Raises ConfigError if the mesh or the settings of the duct cannot be used.
    """
    stages = StartProgress(_STAGES, progress)
    with _one_thread(), _one_sentence(scene):
        mesh = _file_mesh(scene.duct, cache, stages.stage)
        duct = build_scene_duct(scene, cache / "bases", stages.stage, mesh=mesh)
    stages.finish("the duct is there")
    return duct


def load_surface(scene: SceneModel, cache: Path) -> TriangleMesh:
    """Return the surface of the duct as it is meshed, before any constant load; no modes are computed.

    Raises ConfigError if the mesh cannot be used.
    """
    with _one_sentence(scene):
        mesh = _file_mesh(scene.duct, cache, ignore_progress)
        return opened_mesh(scene.duct, scene_mesh(scene.duct) if mesh is None else mesh)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Give linear algebra one thread, and restore what this process had, with what threadpoolctl sets when imported."""
    before = os.environ.get("KMP_DUPLICATE_LIB_OK")
    from threadpoolctl import threadpool_limits

    if before is None:
        os.environ.pop("KMP_DUPLICATE_LIB_OK", None)
    with threadpool_limits(1):
        yield


@contextmanager
def _one_sentence(scene: SceneModel) -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        key = "mesh_file" if scene.duct.mesh_file else "branches" if scene.duct.branches else "cystic"
        raise MissingPackageError(f"{scene.source}: duct.{key}", error.name) from None
    except ValueError as error:
        raise ConfigError(f"{scene.source}: {error}") from None


def _file_mesh(duct: DuctScene, cache: Path, progress: Progress) -> TriangleMesh | None:
    if duct.mesh_file is None and not duct.is_tree:
        return None
    progress("surface", 0.0)
    from trocar.services.meshes import (  # mesh libraries take a second to import and most scenes need none
        MeshError,
        load_mesh,
    )
    from trocar.services.meshes.branching import load_branching

    if duct.mesh_file is None:
        try:
            return load_branching(duct_tubes(duct), duct.mesh_edge_m, cache / "meshes")
        except MeshError as error:
            key = "branches" if duct.branches else "cystic"
            raise ValueError(f"duct.{key}: {error}") from error
    try:
        return load_mesh(
            Path(duct.mesh_file),
            duct.mesh_unit,
            duct.mesh_clamped,
            duct.mesh_mouth,
            duct.mesh_edge_m,
            duct.mesh_lumen_diameter_m,
            cache / "meshes",
            lambda step: progress(f"surface file: {step}", 0.0),
            duct.mesh_names,
            duct.mesh_up,
        )
    except MeshError as error:
        raise ValueError(f"duct.mesh_file: {error}") from error
