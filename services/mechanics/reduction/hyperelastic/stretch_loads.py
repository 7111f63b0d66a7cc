"""Loads that stretch a wall as a whole, whose responses the lowest modes hardly have: they bend and ovalise.

A tube that is inflated or pulled moves by fast patterns, of even strain but for the ends. They are made residual
vectors of the basis, so that the law acts on them too. Where the wall stiffens it moves otherwise: least where it was
stretched most, as round a bend. So the responses to the forces of the stiffening are residual vectors as well.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellModel, pressure_load
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.reduction.large_rotations.sections import axial_coordinate
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane
from trocar.services.mechanics.reduction.residual_vectors import add_residual_vectors
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    triangle_area_vectors,
    triangle_areas_m2,
)

PRESSED_BANDS, PULLED_BANDS = 9, 3
"""Bands along the wall: with 5 and 3 an even pressure to a hoop strain of 0.2 is 2.0 % off, with these 1.9, and one
of half of the duct at a hoop strain of 0.1 is 1.8 % off in place of 3.8."""


def with_stretch_modes(model: ShellModel, basis: ModalBasis) -> tuple[ModalBasis, int]:
    """Add the modes of the stretched wall; also returned is how many they are."""
    groups = stretch_loads(model)
    loads = np.concatenate([*groups, _stiffening_loads(model, groups)])
    return add_residual_vectors(model, basis, loads, len(loads))


def _stiffening_loads(model: ShellModel, groups: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
    """Return the forces (k, n, 3) of the stiffening where the wall is inflated, pulled at its end, and by both."""
    pressed, pulled, at_rims = groups
    loads = [pressed.sum(axis=0), (at_rims if len(at_rims) else pulled).sum(axis=0)]
    moved = model.factor.solve(np.stack([free_load(model, load) for load in loads], axis=1))
    inflated, longer = np.moveaxis(nodal_translations(model, moved), 2, 0)
    longer = longer * np.linalg.norm(inflated) / np.linalg.norm(longer)
    membrane = Membrane.from_model(model)
    states = inflated, longer, inflated + longer, inflated - longer
    return np.stack([membrane.stiffening_force_n(state) for state in states])


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
    return _along(model.mesh, axial_coordinate(model.mesh, np.unique(model.held_dofs // 6)))


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
