"""Meshes from and to files: load, check, repair or refuse, remesh; VTU output. Library, no process."""

from trocar.services.meshes.cached import load_mesh
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.loading import DuctSurface, SurfaceSettings, load_duct_surface
from trocar.services.meshes.writing import write_vtu

__all__ = ["DuctSurface", "MeshError", "SurfaceSettings", "load_duct_surface", "load_mesh", "write_vtu"]
