"""The surface in a VTP file; what VTK finds wrong with it is one sentence."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from trocar.services.meshes.announced import judge_counts
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.surface_data import DoubleArray, Int64Array, SurfaceData, strip_triangles

DEEPEST = 32
"""Elements within each other: several times the seven that VTK's files have."""
_TAIL_BYTES = 1024
_BLOCK_BYTES = 1 << 20
_SAID = re.compile(r"\(0x[0-9a-f]+\): (.+?)\s*$", re.MULTILINE)


def read_vtp(path: Path) -> SurfaceData:
    """Return vertices, polygons and strips; lines and single points are left out.

    Raises MeshError: says what VTK said first, or which of the file's numbers cannot be.
    """
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    surface = read_by_vtk(path, vtkXMLPolyDataReader())
    vertices = points_of(surface)
    corners, counts = _cells(path, surface.GetPolys(), "Polys")
    strips, lengths = _cells(path, surface.GetStrips(), "Strips")
    ends = np.cumsum(lengths)
    for strip in np.split(strips, ends[:-1]) if len(lengths) else ():
        triangles = strip_triangles(strip)
        corners = np.concatenate([corners, triangles.ravel()])
        counts = np.concatenate([counts, np.full(len(triangles), 3)])
    judge_counts(path, int(np.maximum(counts - 2, 0).sum()), len(vertices))
    return SurfaceData(vertices, corners, counts)


def read_by_vtk(path: Path, reader: Any) -> Any:
    """Return what a reader of VTK's XML files makes of a file. Raises MeshError: says what it said first."""
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

    _judge_elements(path)
    told = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(told)
    reader.SetFileName(str(path))
    reader.Update()
    if said := told.GetOutput():
        found = _SAID.search(said)
        sentence = (found[1] if found else " ".join(said.split())[:200]).rstrip(".")
        raise MeshError(f"{path}: not a readable triangle surface ({sentence})")
    return reader.GetOutput()


def points_of(data: Any) -> DoubleArray:
    """Return the points (n, 3) of a data set of VTK."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    points = data.GetPoints()
    return np.zeros((0, 3)) if points is None else np.asarray(vtk_to_numpy(points.GetData()), np.float64)


def _cells(path: Path, cells: object, name: str) -> tuple[Int64Array, Int64Array]:
    """Return the corners of all cells, and how many each has, as the file tells them."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    offsets = np.asarray(vtk_to_numpy(cells.GetOffsetsArray()), np.int64)  # type: ignore[attr-defined]
    corners = np.asarray(vtk_to_numpy(cells.GetConnectivityArray()), np.int64)  # type: ignore[attr-defined]
    if len(offsets) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    counts = np.diff(offsets)
    if offsets[0] < 0 or (counts < 0).any() or offsets[-1] > len(corners):
        raise MeshError(f"{path}: the offsets of its {name} do not fit the {len(corners)} corners that it holds")
    return corners[offsets[0] : offsets[-1]].copy(), counts


class _DataBeginError(Exception):
    """From here on it need not be XML."""


def _judge_elements(path: Path) -> None:
    """Refuse what VTK would end by: more than is read, elements within elements without end.

    Raises MeshError.
    """
    depth, announced = 0, [0, 0]

    def begin(name: str, attributes: Mapping[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise MeshError(f"{path}: has elements within each other, more than {DEEPEST} deep")
        if name == "AppendedData":
            raise _DataBeginError
        if name == "Piece":
            for each in ("NumberOfPolys", "NumberOfStrips", "NumberOfCells"):
                announced[0] += _number(attributes, each)
            announced[1] += _number(attributes, "NumberOfPoints")
            judge_counts(path, *announced)
            judge_counts(path, max(_number(attributes, "NumberOfLines"), _number(attributes, "NumberOfVerts")))

    def end(_name: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
        is_whole = b"</VTKFile>" in file.read()
        if not is_whole:
            raise MeshError(f"{path}: the file is cut off, it does not end with '</VTKFile>'")
        file.seek(0)
        try:
            while block := file.read(_BLOCK_BYTES):
                parser.Parse(block)
            parser.Parse(b"", True)
        except _DataBeginError:
            pass
        except expat.ExpatError as error:
            raise MeshError(f"{path}: not a readable triangle surface ({error})") from None


def _number(attributes: Mapping[str, str], name: str) -> int:
    text = attributes.get(name, "0").strip()
    return int(text) if text.isdecimal() and len(text) < 30 else 0
