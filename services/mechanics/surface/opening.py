"""An open end of a duct: its place, direction and width."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh

_NEAREST, _FURTHEST = 2.0, 3.5
"""Range of distances from the rim, in its radii, in which the middle of the lumen is measured."""


@dataclass(frozen=True, slots=True)
class Opening:
    """An open end.

    Attributes:
        centre_m: (3,) float64. Middle of the rim.
        inward: (3,) float64. Unit vector from there to the middle of the lumen 2 to 3.5 radii behind: the direction of
            insertion, which differs from the normal of an oblique rim.
        radius_m: float. Mean distance of the rim from its middle.
    """

    centre_m: FloatArray
    inward: FloatArray
    radius_m: float


def mouth_opening(mesh: TriangleMesh, name: str = "mouth") -> Opening:
    """Return the mouth of a duct, or another of its openings by the name of its set of vertices.

    Raises ValueError: there is no such opening, or the duct is too short or too coarsely meshed there to find the
    direction of insertion.
    """
    if name not in mesh.vertex_sets:
        raise ValueError(f"duct: there is no opening {name!r}; there are {', '.join(sorted(mesh.vertex_sets))}")
    rim = mesh.vertices_m[mesh.vertex_sets[name]]
    centre = rim.mean(axis=0)
    radius_m = float(np.linalg.norm(rim - centre, axis=1).mean())
    away = mesh.vertices_m - centre
    distance = np.linalg.norm(away, axis=1)
    ring = away[(distance > _NEAREST * radius_m) & (distance < _FURTHEST * radius_m)]
    if not len(ring):
        raise ValueError(
            f"duct: no vertex lies {_NEAREST:g} to {_FURTHEST:g} radii ({radius_m:.3g} m) behind its mouth, where the "
            "way in is looked for: it is too short for its width, or too coarse"
        )
    inward = ring.mean(axis=0)
    return Opening(centre, inward / float(np.linalg.norm(inward)), radius_m)
