"""Faces of many corners as triangles: the same surface whichever corner comes first."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.surface_data import DoubleArray, Int64Array, SurfaceData

FLAT = 1e-9
"""Part of a face's area below which a triangle of it is flat."""


def split_faces(path: Path, data: SurfaceData) -> Int64Array:
    """Return the triangles (m, 3) of all faces, in the faces' order; those of fewer than three corners have none.

    A convex face is a fan round its first corner. From one that is not ears are cut: a fan would fold over.
    Raises MeshError if a corner names no vertex, or a face crosses itself.
    """
    _check_corners(path, data)
    few = int((data.counts < 3).sum())
    if few:
        data.actions.append(f"dropped {few} faces of fewer than three corners")
    starts = np.cumsum(data.counts) - data.counts
    parts: list[Int64Array] = [np.zeros((0, 3), np.int64)]
    faces: list[Int64Array] = [np.zeros(0, np.int64)]
    for count in np.unique(data.counts[data.counts >= 3]).tolist():
        of_count = np.flatnonzero(data.counts == count)
        polygons = data.corners[starts[of_count, None] + np.arange(count)]
        triangles, place = _split_alike(path, data, of_count, polygons)
        parts.append(triangles)
        faces.append(of_count[place])
    order = np.argsort(np.concatenate(faces), kind="stable")
    return np.concatenate(parts)[order]


def _check_corners(path: Path, data: SurfaceData) -> None:
    strange = np.flatnonzero((data.corners < 0) | (data.corners >= len(data.vertices)))
    if len(strange):
        face = int(np.searchsorted(np.cumsum(data.counts), strange[0], side="right"))
        named, n = int(data.corners[strange[0]]), len(data.vertices)
        raise MeshError(f"{path}: {_name(data, face)} names vertex {named}, the file has {n}, which count from 0")


def _name(data: SurfaceData, face: int) -> str:
    return f"line {data.lines[face]}: a face" if len(data.lines) else f"face {face}"


def _split_alike(
    path: Path, data: SurfaceData, faces: Int64Array, polygons: Int64Array
) -> tuple[Int64Array, Int64Array]:
    """Return triangles and the polygon of each, of polygons (f, k) of one number of corners."""
    n, k = polygons.shape
    if k == 3:
        return polygons, np.arange(n)
    folded = _fan_folds(data.vertices, polygons)
    if k == 4 and folded.any():  # of two ways to cut it, one is right where the other folds
        polygons = np.where(folded[:, None], np.roll(polygons, -1, axis=1), polygons)
        folded = _fan_folds(data.vertices, polygons)
    fan = polygons[~folded]
    place = np.flatnonzero(~folded)
    middle = np.arange(1, k - 1)
    triangles = np.stack([np.repeat(fan[:, :1], k - 2, axis=1), fan[:, middle], fan[:, middle + 1]], axis=2)
    parts, places = [triangles.reshape(-1, 3)], [np.repeat(place, k - 2)]
    if folded.any():
        cut, of = _cut_ears(data.vertices, polygons[folded])
        place = np.flatnonzero(folded)
        missing = np.bincount(of, minlength=len(place)) != k - 2
        if missing.any():
            face = int(faces[place[np.argmax(missing)]])
            raise MeshError(f"{path}: {_name(data, face)} of {k} corners crosses itself")
        parts.append(cut)
        places.append(place[of])
    return np.concatenate(parts), np.concatenate(places)


def _fan_folds(vertices: DoubleArray, polygons: Int64Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(f,) whether a fan round the first corner has a triangle that faces the other way or is flat, as others are not.

    A face without an area folds nothing: all of it is dropped later.
    """
    points = vertices[polygons]
    spokes = points[:, 1:] - points[:, :1]
    areas = np.cross(spokes[:, :-1], spokes[:, 1:])
    normal = areas.sum(axis=1)
    squared = np.einsum("ij,ij->i", normal, normal)
    along = np.einsum("ikj,ij->ik", areas, normal)
    folds: np.ndarray[tuple[int], np.dtype[np.bool_]] = (along <= FLAT * squared[:, None]).any(axis=1) & (squared > 0)
    return folds


def _cut_ears(vertices: DoubleArray, polygons: Int64Array) -> tuple[Int64Array, Int64Array]:
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    used, corners = np.unique(polygons, return_inverse=True)
    n, k = polygons.shape
    points, cells, surface = vtkPoints(), vtkCellArray(), vtkPolyData()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(vertices[used], deep=True))
    offsets, of = k * np.arange(n + 1, dtype=np.int64), np.arange(n, dtype=np.int64)
    flat = corners.astype(np.int64).ravel()
    cells.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(flat, deep=True))
    surface.SetPoints(points)
    surface.SetPolys(cells)
    numbers = numpy_to_vtkIdTypeArray(of, deep=True)
    numbers.SetName("polygon")
    surface.GetCellData().AddArray(numbers)
    ears = vtkTriangleFilter()
    ears.SetInputData(surface)
    ears.Update()
    cut = ears.GetOutput()
    triangles = np.asarray(vtk_to_numpy(cut.GetPolys().GetConnectivityArray()), np.int64).reshape(-1, 3)
    return used[triangles], np.asarray(vtk_to_numpy(cut.GetCellData().GetArray("polygon")), np.int64)
