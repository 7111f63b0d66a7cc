"""Meshes from and to files: load, check, repair or refuse, remesh; VTU output. Library, no process."""

from services.meshes.cached import load_mesh
from services.meshes.errors import MeshError
from services.meshes.loading import DuctSurface, SurfaceSettings, load_duct_surface
from services.meshes.writing import write_vtu

__all__ = ["DuctSurface", "MeshError", "SurfaceSettings", "load_duct_surface", "load_mesh", "write_vtu"]
