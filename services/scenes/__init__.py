"""Scene files: from YAML to the mechanics' own data, with meshes and bases. Library, no process."""

from trocar.services.scenes.load import load_scene, scene_origins
from trocar.services.scenes.ready import check_duct, load_duct, load_surface
from trocar.services.scenes.scene_file import build_scene, scene_file_type

__all__ = ["build_scene", "check_duct", "load_duct", "load_scene", "load_surface", "scene_file_type", "scene_origins"]
