"""How thick the wall is, and the surface midway in it on which a shell is meshed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.anatomy.label_surface import label_surface, moved_out
from trocar.services.anatomy.patient_surface import PatientSurface, distances_m
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.meshes.errors import MeshError

ASSUMED_M = 1.0e-3
"""Where nothing is said: walls of about 1 mm are quoted without measurement."""
THICKNESS_M = (0.1e-3, 5e-3)
_STEPS = 4
"""In which a surface is moved, as normals turn on the way."""


@dataclass(frozen=True)
class Wall:
    """A wall, and where its thickness is from.

    Attributes:
        thickness_m: Of the whole shell.
        spread_m: (5 %, 95 %) of a measured one, None of one that was said.
        source: In words.
    """

    thickness_m: float
    spread_m: tuple[float, float] | None
    source: str


def wall_of(surface: PatientSurface, said_m: float | None) -> Wall:
    """Return the wall's thickness: as said, or measured between the label's surface and that of the wall's label.

    Raises MeshError if the wall's label is not round the duct's, or a thickness is no duct's.
    """
    if said_m is not None:
        return _judged(Wall(said_m, None, "as said"))
    volume = surface.volume
    if volume is None or surface.mask is None or not volume.wall.any():
        return Wall(ASSUMED_M, None, "an assumption: give --thickness-mm, or --wall with the wall's label")
    whole = scipy.ndimage.binary_fill_holes(surface.mask | volume.wall)
    outer = label_surface(volume, whole)
    thickness = distances_m(outer, surface.mesh.vertices_m)
    low, middle, high = (float(np.percentile(thickness, share)) for share in (5.0, 50.0, 95.0))
    return _judged(Wall(middle, (low, high), "measured from the label of the wall"))


def _judged(wall: Wall) -> Wall:
    low, high = THICKNESS_M
    if not low <= wall.thickness_m <= high:
        raise MeshError(
            f"a wall of {1e3 * wall.thickness_m:.3g} mm ({wall.source}) is no duct's: "
            f"{1e3 * low:g} to {1e3 * high:g} mm"
        )
    return wall


def middle_of_wall(lumen: TriangleMesh, wall: Wall) -> TriangleMesh:
    """Return the surface half a wall outside the lumen's."""
    mesh = lumen
    for _ in range(_STEPS):
        mesh = moved_out(mesh, 0.5 * wall.thickness_m / _STEPS)
    return mesh
