"""Meshes from and to files: load, check, repair or refuse, remesh; VTU output. Library, no process."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trocar.services.meshes.cached import load_mesh as load_mesh
    from trocar.services.meshes.errors import MeshError as MeshError
    from trocar.services.meshes.loading import DuctSurface as DuctSurface
    from trocar.services.meshes.loading import SurfaceSettings as SurfaceSettings
    from trocar.services.meshes.loading import load_duct_surface as load_duct_surface
    from trocar.services.meshes.writing import write_vtu as write_vtu

_PLACES = {
    "DuctSurface": "loading",
    "MeshError": "errors",
    "SurfaceSettings": "loading",
    "load_duct_surface": "loading",
    "load_mesh": "cached",
    "write_vtu": "writing",
}

__all__ = ["DuctSurface", "MeshError", "SurfaceSettings", "load_duct_surface", "load_mesh", "write_vtu"]


def __getattr__(name: str) -> object:
    """Return a public name: a reader of files imports modules of this package, and none of the mechanics."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
