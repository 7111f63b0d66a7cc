"""Loads that stretch a wall as a whole, whose responses the lowest modes hardly have: they bend and ovalise.

A tube that is inflated or pulled moves by fast patterns, of even strain but for the ends. They are made residual
vectors of the basis, so that a law acts on them too, see `stretched_states`.
"""

from __future__ import annotations

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel, pressure_load
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction.large_rotations.sections import axial_coordinate, cotangent_laplacian
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    triangle_area_vectors,
    triangle_areas_m2,
)

PRESSED_BANDS, PULLED_BANDS = 9, 3
"""Bands along the wall: with 5 and 3 an even pressure to a hoop strain of 0.2 is 2.0 % off, with these 1.9, and one
of half of the duct at a hoop strain of 0.1 is 1.8 % off in place of 3.8."""

PLANE = 0.05
"""Of a rim's width: its largest departure from a plane. Cells are a tenth of it."""


def stretch_loads(model: ShellModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pressures in bands along the wall, pulls along it in bands, and pulls at open rims, each (k, n, 3)."""
    mesh = model.mesh
    held = np.unique(model.held_dofs // 6)
    place = axial_coordinate(mesh, held)
    along = _along(mesh, place)
    pressed = _bands(place, PRESSED_BANDS)[:, :, None] * pressure_load(mesh, 1.0)
    pulled = (_bands(place, PULLED_BANDS) * model.mass_kg)[:, :, None] * along
    rims = [rim for rim in boundary_loops(mesh) if not np.isin(rim, held).any()]
    at_rims = np.zeros((len(rims), mesh.n_vertices, 3))
    for load, rim in zip(at_rims, rims, strict=True):
        load[rim] = along[rim]
    for load in (pressed, pulled):
        load[:, held] = 0.0
    moving = [load[np.abs(load).max(axis=(1, 2)) > 0.0] for load in (pressed, pulled, at_rims)]
    return moving[0], moving[1], moving[2]


def axial_directions(model: ShellModel) -> FloatArray:
    """Return (n, 3) unit vectors along the wall, away from where it is held."""
    held = np.unique(model.held_dofs // 6)
    return _along(model.mesh, _level_at_rims(model.mesh, axial_coordinate(model.mesh, held), held))


def _level_at_rims(mesh: TriangleMesh, place: FloatArray, held: IntArray) -> FloatArray:
    """Return a coordinate (n,) along the wall that is even on plane rims, and harmonic up to where the wall is held.

    ``place`` is flat at open ends, where directions along it are up to 30 degrees off round a bend. Round a bend of one
    radius this is the angle, exactly. A wall without plane rims keeps ``place``.
    """
    rims = [rim for rim in boundary_loops(mesh) if not np.isin(rim, held).any() and _is_plane(mesh.vertices_m[rim])]
    if not rims:
        return place
    fixed, even = np.concatenate([held, *rims]), np.zeros(len(place))
    for rim in rims:
        even[rim] = place[rim].mean()
    free, laplacian = np.setdiff1d(np.arange(mesh.n_vertices), fixed), cotangent_laplacian(mesh)
    even[free] = factorise(scipy.sparse.csc_array(laplacian[free][:, free])).solve(-(laplacian @ even)[free])
    return even


def _is_plane(points_m: FloatArray) -> bool:
    """Whether points (k, 3) lie in a plane, as a cut straight across leaves them; those of a slit do not."""
    _, across, _ = np.linalg.svd(points_m - points_m.mean(axis=0), full_matrices=False)
    return bool(across[2] <= PLANE * across[1])


def _bands(place: FloatArray, n_bands: int) -> FloatArray:
    """Piecewise linear weights (k, n) that add up to one, each highest at its station."""
    stations = np.linspace(0.0, 1.0, n_bands)
    return np.stack([np.interp(place, stations, row) for row in np.eye(n_bands)])


def _along(mesh: TriangleMesh, place: FloatArray) -> FloatArray:
    """(n, 3) unit vectors in which ``place`` (n,) grows."""
    corners, normal = mesh.vertices_m[mesh.triangles], triangle_area_vectors(mesh)
    opposite = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)
    slope = np.einsum("mi,mij->mj", place[mesh.triangles], np.cross(normal[:, None], opposite))
    total = np.zeros((mesh.n_vertices, 3))
    np.add.at(total, mesh.triangles, (slope / triangle_areas_m2(mesh)[:, None])[:, None])
    unit: FloatArray = total / np.linalg.norm(total, axis=1, keepdims=True)
    return unit
