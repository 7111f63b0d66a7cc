"""Cells that a scene file leaves to the rule: ``n_around: auto``, ``n_along: auto``."""

from __future__ import annotations

from typing import Any

from trocar.services.mechanics.scene import DuctScene, ForcepsScene
from trocar.services.mechanics.scene.mesh_cells import MOST_NODES, MOST_NODES_ALL_PAIRS, accurate_cells
from trocar.services.runtime.config import config
from trocar.services.scenes.limits import LARGEST

AUTO = "auto"
_NO_COPIES = ("curvature_1_m", "cut_angle_rad", "slit_length_m", "incision")
"""What makes the parts of a duct differ from each other, so that its residual compliance is kept between all pairs."""


def take_automatic_cells(data: dict[str, Any], origins: config.Origins) -> None:
    """Put numbers of cells where ``data`` says ``auto``; they follow from radius, length and the narrowest jaw.

    What is no length is left to the check that follows: cells are then those of a duct with the usual value.
    """
    duct = data.get("duct")
    if not isinstance(duct, dict):
        return
    usual = DuctScene()
    radius_m, length_m = (_positive(duct.get(key), getattr(usual, key)) for key in ("radius_m", "length_m"))
    has_copies = not any(duct.get(key) for key in _NO_COPIES)
    most_nodes = MOST_NODES if has_copies else MOST_NODES_ALL_PAIRS
    cells = accurate_cells(radius_m, length_m, _narrowest_jaw_m(data.get("forceps")), most_nodes)
    for key, count in zip(("n_around", "n_along"), cells, strict=True):
        if duct.get(key) == AUTO:
            duct[key] = count
            path = f"duct.{key}"
            origins[path] = f"auto in {origins.get(path, 'the scene')}"


def _narrowest_jaw_m(forceps: object) -> float:
    usual = ForcepsScene().jaw_radius_m
    tools = [tool for tool in forceps if isinstance(tool, dict)] if isinstance(forceps, list) else []
    return min((_positive(tool.get("jaw_radius_m"), usual) for tool in tools), default=usual)


def _positive(value: object, otherwise: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return otherwise
    return float(value) if 1.0 / LARGEST <= value <= LARGEST else otherwise
