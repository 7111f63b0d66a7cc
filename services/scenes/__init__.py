"""Scene files: from YAML to the mechanics' own data, with meshes and bases. Library, no process."""

from services.scenes.load import load_scene, scene_origins
from services.scenes.ready import load_duct

__all__ = ["load_duct", "load_scene", "scene_origins"]
