"""Duct meshes from files, made once and kept: every process of a rig gets the very same vertices."""

from __future__ import annotations

import dataclasses
from importlib.metadata import version
from pathlib import Path
from typing import Any

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction.cache import Entry, fetch
from trocar.services.mechanics.reduction.content_hash import entry_name
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.meshes.announced import judge_place
from trocar.services.meshes.loading import OnStep, SurfaceSettings, load_duct_surface
from trocar.services.meshes.reading import READER

MESH_LIBRARIES = ("trimesh", "pyvista", "pyacvd", "vtk")


def load_mesh(
    path: Path,
    units: str,
    clamped: tuple[str, ...] = ("end_0",),
    mouth: str = "end_1",
    edge_m: float | None = None,
    lumen_diameter_m: float | None = None,
    cache_dir: Path | None = None,
    on_step: OnStep = lambda step: None,
    names: tuple[str, ...] = (),
    up: tuple[float, float, float] | None = None,
) -> TriangleMesh:
    """Return the duct in a surface file, from the cache if this file was made into it before.

    See `trocar.services.meshes.loading.SurfaceSettings` for the choices. The entry's name is made of the file's bytes,
    the choices, the code and the versions of the mesh libraries.
    Raises MeshError if the surface cannot be used; the sentence names the file, the reason and the place.
    """
    settings = SurfaceSettings(units, clamped, mouth, edge_m, lumen_diameter_m, names, up)
    judge_place(path)
    libraries = [f"{name} {version(name)}" for name in MESH_LIBRARIES]
    made_of = path.read_bytes(), path.suffix, dataclasses.asdict(settings), libraries
    name = entry_name("mesh", (__name__, READER), *made_of)

    def make(entry: Entry) -> None:
        duct = load_duct_surface(path, settings, on_step)
        write_entry(entry, duct.mesh, path=str(path), actions=duct.actions)

    return read_entry(fetch(cache_dir or cache_directory(), name, make))


def write_entry(entry: Entry, mesh: TriangleMesh, **facts: Any) -> None:
    """Keep a mesh, with further facts."""
    entry.save("vertices_m", mesh.vertices_m)
    entry.save("triangles", mesh.triangles)
    for set_name, vertices in mesh.vertex_sets.items():
        entry.save(f"set-{set_name}", vertices)
    entry.describe(sets=list(mesh.vertex_sets), **facts)


def read_entry(entry: Entry) -> TriangleMesh:
    """Return a mesh that was kept."""
    sets = {set_name: entry.load(f"set-{set_name}") for set_name in entry.facts["sets"]}
    return TriangleMesh(entry.load("vertices_m"), entry.load("triangles"), sets)
