"""Traction: the neck of the gallbladder is pulled, and the duct with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.effects.base import Effect, require_not_negative
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.opening import mouth_opening

MOUTH = "mouth"


@dataclass(frozen=True, slots=True)
class TractionSettings:
    """A constant pull on the rim of the mouth, where the duct was cut from the neck.

    ``force_n`` is by default what stretches a bile duct by a quarter: 5 kPa on the closed end of one 8.6 mm wide (Duch
    2004, ten porcine common bile ducts). ``direction`` is that of the pull, in scene axes; by default out of the mouth.
    """

    force_n: float = 0.29
    direction: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        require_not_negative(self, "force_n")
        if self.direction is not None and not np.linalg.norm(self.direction) > 0.0:
            raise ValueError("direction must not be zero")


class Traction(Effect):
    """Constant load on the rim of the mouth, evenly along it: part of the rest shape, at no cost in a step.

    It is conservative. The wall is linear: folds are pulled flat and bends straightened to first order. A hand that
    pulls by itself grasps the rim with forceps, and needs no effect.
    """

    Settings = TractionSettings
    of_wall = True

    def check_mesh(self, mesh: TriangleMesh) -> None:
        """Refuse a duct without a mouth."""
        if MOUTH not in mesh.vertex_sets:
            raise ValueError("effects.traction: the duct has no mouth to be pulled at")

    def constant_load_n(self, mesh: TriangleMesh) -> FloatArray:
        """Pull (n, 3) on the nodes of the rim."""
        rim = mesh.vertex_sets[MOUTH]
        said = self.settings.direction
        away = -mouth_opening(mesh).inward if said is None else np.array(said, dtype=np.float64)
        lengths_m = np.linalg.norm(mesh.vertices_m[np.roll(rim, -1)] - mesh.vertices_m[rim], axis=1)
        shares = 0.5 * (lengths_m + np.roll(lengths_m, 1)) / lengths_m.sum()
        load = np.zeros_like(mesh.vertices_m)
        load[rim] = shares[:, None] * (self.settings.force_n * away / np.linalg.norm(away))
        return load
