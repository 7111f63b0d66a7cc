"""The closed surface of a duct in the patient's LPS axes, from a label or from a surface file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trocar.services.anatomy.label_surface import clean_mask, label_surface
from trocar.services.anatomy.volume import LabelVolume, Mask, read_volume
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.openings import SurfaceOpening, find_openings
from trocar.services.meshes.plausibility import judge_unit
from trocar.services.meshes.reading import read_surface
from trocar.services.meshes.repairing import repair_surface

_SPACE = re.compile(rb"SPACE\s*=\s*(RAS|LPS)", re.IGNORECASE)
_HEAD_BYTES = 4096
_LPS_OF_RAS = np.array([-1.0, -1.0, 1.0])


@dataclass(frozen=True)
class PatientSurface:
    """A closed surface, and what it was made of.

    Attributes:
        mesh: Wound outwards; metres in LPS axes: x to the patient's left, y to the back, z to the head.
        actions: What was done.
        volume, mask: The label it is the surface of; None of a file that is a surface.
        rims: Open ends that the file had, which are closed here.
        boundary_error_m: (p50, p95, greatest) distance of the label's voxel boundary from the surface; None without.
    """

    mesh: TriangleMesh
    actions: list[str]
    volume: LabelVolume | None = None
    mask: Mask | None = None
    rims: tuple[SurfaceOpening, ...] = ()
    boundary_error_m: tuple[float, float, float] | None = None


def of_label(path: Path, label: str | None, wall: str | None) -> PatientSurface:
    """Return the smooth surface of a label of a volume.

    Raises MeshError if the label makes no closed surface; the sentence names the file and the place.
    """
    volume = read_volume(path, label, wall)
    try:
        actions: list[str] = []
        mask = clean_mask(volume, volume.mask, actions)
        mesh = label_surface(volume, mask)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error
    actions.append(f"made a smooth surface of {mesh.n_triangles} triangles that encloses the label's volume")
    return PatientSurface(mesh, actions, volume, mask, (), boundary_error_m(mesh, volume, mask))


def of_surface(path: Path, units: str, axes: str | None) -> PatientSurface:
    """Return the surface of a file, with its open ends closed.

    ``axes`` are LPS or RAS; without, what the file says, as those of 3D Slicer do, or LPS.
    Raises MeshError if the file is no usable surface; the sentence names the file and the place.
    """
    actions: list[str] = []
    raw = read_surface(path, units, actions)
    told = axes or said_axes(path)
    if told == "RAS":
        raw = TriangleMesh(raw.vertices_m * _LPS_OF_RAS, raw.triangles)
        actions.append("turned from RAS to LPS axes")
    try:
        judge_unit(raw, units)
        repaired = repair_surface(raw, is_used=False, may_be_closed=True)
        actions += repaired.actions
        rims = tuple(find_openings(repaired.mesh))
        return PatientSurface(capped(repaired.mesh, rims), actions, rims=rims)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error


def said_axes(path: Path) -> str:
    """Return the axes that a surface file names in its first lines, as 3D Slicer writes them; LPS without."""
    with path.open("rb") as file:
        said = _SPACE.search(file.read(_HEAD_BYTES))
    return said[1].decode().upper() if said else "LPS"


def capped(mesh: TriangleMesh, rims: tuple[SurfaceOpening, ...]) -> TriangleMesh:
    """Return a surface whose open rims are closed by fans."""
    vertices, triangles = [mesh.vertices_m], [mesh.triangles]
    for k, rim in enumerate(rims):
        centre = np.full_like(rim.rim, mesh.n_vertices + k)
        vertices.append(rim.centre_m[None])
        triangles.append(np.stack([centre, np.roll(rim.rim, -1), rim.rim], axis=1))
    return TriangleMesh(np.concatenate(vertices), np.concatenate(triangles))


def boundary_error_m(mesh: TriangleMesh, volume: LabelVolume, mask: Mask) -> tuple[float, float, float]:
    """Return median, 95 % and greatest distance of a surface from the faces between a mask's voxels and others."""
    places = volume.place_m(_boundary(mask))
    distance = distances_m(mesh, places)
    return float(np.median(distance)), float(np.percentile(distance, 95.0)), float(distance.max())


def _boundary(mask: Mask) -> FloatArray:
    """Return indices (n, 3) of the middles of a mask's outer faces."""
    padded = np.pad(mask, 1)
    faces = []
    for axis in range(3):
        steps = np.argwhere(np.diff(padded.astype(np.int8), axis=axis) != 0).astype(np.float64) - 1.0
        steps[:, axis] += 0.5
        faces.append(steps)
    return np.concatenate(faces)


def distances_m(mesh: TriangleMesh, places_m: FloatArray) -> FloatArray:
    """Return the distance (n,) of places (n, 3) from a surface."""
    import pyvista

    cloud = pyvista.PolyData(places_m)
    cloud.compute_implicit_distance(pyvista.PolyData.from_regular_faces(mesh.vertices_m, mesh.triangles), inplace=True)
    distance: FloatArray = np.abs(np.asarray(cloud["implicit_distance"], dtype=np.float64))
    return distance
