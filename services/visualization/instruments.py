"""Shapes of the instruments' parts in their own frames: x along the shaft, y the way jaw A opens."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyvista as pv

from trocar.services.mechanics.arrays import Float32Array
from trocar.services.mechanics.scene.instruments import DrawnPart
from trocar.services.visualization.picture import ToolShape
from trocar.services.visualization.tube import sweep_tube, tube_triangles

_RINGS, _ARCS = 64, 10  # so that a jaw's teeth have some rings each, and its back no corners that are seen


def round_part(part: DrawnPart) -> pv.PolyData:
    """Return the surface of revolution of a part about the shaft's axis."""
    return _lathe(part.profile)


def cannula(shape: ToolShape) -> pv.PolyData:
    """Return the port's tube, in which the shaft slides."""
    r = shape.shaft_radius_m
    return _lathe([(-42e-3, 2.6 * r), (-30e-3, 3.4 * r), (-30e-3, 1.7 * r), (16e-3, 1.7 * r)])


def jaw(shape: ToolShape) -> pv.PolyData:
    """Return a jaw along +x from the hinge: half round outside (+y), flat and toothed inside, blunt at the end."""
    length, radius = shape.jaw_length_m, shape.jaw_radius_m
    share = np.linspace(0.0, 1.0, _RINGS + 1)[:, None]
    end = np.sqrt(np.maximum(0.0, 1.0 - np.maximum(0.0, (share - 0.9) / 0.1) ** 2))
    wide = radius * (1.55 - 0.5 * share) * (0.25 + 0.75 * end)
    high = radius * (1.25 - 0.25 * share) * (0.3 + 0.7 * end)
    angle = np.pi * np.arange(_ARCS + 1) / _ARCS
    ring = np.arange(_RINGS + 1)[:, None]
    tooth = np.where((share > 0.22) & (share < 0.95), 0.22 * radius * ((ring % 2) * 2 - 1), 0.0)
    flat = -0.9 * radius + tooth
    y = np.hstack([-0.78 * radius + 1.1 * (high + 0.5 * radius) * np.sin(angle), flat, flat])
    z = np.hstack([wide * np.cos(angle), -0.9 * wide, 0.9 * wide])
    points_m = np.stack([np.broadcast_to(length * share, y.shape), y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    around = _ARCS + 3
    fan = np.arange(1, around - 1)
    near = np.stack([np.zeros_like(fan), fan, fan + 1], axis=1)
    far = _RINGS * around + near[:, [0, 2, 1]]
    return _creased(points_m, np.concatenate([tube_triangles(_RINGS + 1, around)[:, [0, 2, 1]], near, far]))


def arrow() -> tuple[pv.PolyData, pv.PolyData]:
    """Return stem (1 m long) and head of the arrow of a force along +x, both from the origin."""
    return _lathe([(0.0, 2.8e-4), (1.0, 2.8e-4)]), _lathe([(0.0, 0.0), (0.0, 8.5e-4), (2.2e-3, 0.0)])


def _lathe(profile: Sequence[tuple[float, float]], sides: int = 28) -> pv.PolyData:
    """Return the surface of revolution of a profile of (x, radius) about x."""
    x, radii = np.array(profile, np.float32).T
    line = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    line[:, 0] += 1e-7 * np.arange(len(x))  # gives steps of the profile a direction
    points_m, normals = np.zeros((2, len(x) * sides, 3), np.float32)
    sweep_tube(line, np.ascontiguousarray(radii), points_m, normals)
    return _creased(points_m, tube_triangles(len(x), sides))


def _creased(points_m: Float32Array, triangles: np.ndarray) -> pv.PolyData:
    faces = np.hstack([np.full((len(triangles), 1), 3), triangles]).ravel()
    mesh = pv.PolyData(np.ascontiguousarray(points_m, np.float32), faces).clean()
    return mesh.compute_normals(split_vertices=True, feature_angle=35.0, auto_orient_normals=False)
