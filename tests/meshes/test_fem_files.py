"""Files of finite elements: faces and groups as they are in MSH, INP and VTU, and a sentence for what is wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.foreign_files.whole_files import TUBE, gmsh22, gmsh41, inp, of_finite_elements, vtu
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.reading import read_surface
from trocar.services.meshes.repairing import merge_and_drop

pytest.importorskip("meshio", reason="the mesh extra is not installed")
RIM = {"shells.inp": "RIM"}


def read(folder: Path, data: bytes | str, name: str) -> object:
    (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)
    return read_surface(folder / name, "mm")


@pytest.mark.parametrize("name", of_finite_elements())
def test_each_format_holds_the_same_surface_and_rim(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(of_finite_elements()[name])
    mesh = read_surface(tmp_path / name, "mm")
    np.testing.assert_allclose(mesh.vertices_m, TUBE.vertices_m, atol=1e-12)
    np.testing.assert_array_equal(mesh.triangles, TUBE.triangles)
    rim = RIM.get(name, "rim")
    np.testing.assert_array_equal(mesh.vertex_sets[rim], np.sort(TUBE.vertex_sets["clamped"]))
    merged = merge_and_drop(mesh, [])
    np.testing.assert_array_equal(merged.vertices_m[merged.vertex_sets[rim]].mean(axis=0).round(12), 0.0)


def test_other_groups_are_there_by_their_names(tmp_path: Path) -> None:
    shells = read(tmp_path, inp(TUBE), "a.inp").vertex_sets  # type: ignore[attr-defined]
    assert set(shells) == {"ALL", "RIM", "WALL", "FIRST"}
    np.testing.assert_array_equal(shells["FIRST"], np.unique(TUBE.triangles[:9:2]))
    assert set(read(tmp_path, gmsh41(TUBE, True), "a.msh").vertex_sets) == {"wall", "rim"}  # type: ignore[attr-defined]
    assert set(read(tmp_path, vtu(TUBE), "a.vtu").vertex_sets) == {"rim", "part=0", "part=1", "part=2"}  # type: ignore[attr-defined]


SQUARE = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0\n"


def test_quads_are_cut_and_edges_of_second_order_are_straight(tmp_path: Path) -> None:
    quad = read(tmp_path, SQUARE + "*ELEMENT, TYPE=S4R, ELSET=A\n1, 1, 2, 3, 4\n", "a.inp")
    assert quad.n_triangles == 2  # type: ignore[attr-defined]
    middles = "5, .5, 0, 0\n6, 1, .5, 0\n7, .5, .5, 0\n"
    data = SQUARE + middles + "*ELEMENT, TYPE=STRI65\n7, 1, 2, 3,\n5, 6, 7\n"
    (tmp_path / "b.inp").write_text(data)
    actions: list[str] = []
    assert read_surface(tmp_path / "b.inp", "m", actions).n_triangles == 1
    assert actions == ["took the corners of 1 faces of second order, whose edges are straight now"]


def test_faces_beside_solid_cells_are_read_and_it_is_told(tmp_path: Path) -> None:
    data = SQUARE + "5, 0, 0, 1\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 5\n*ELEMENT, TYPE=S3\n2, 1, 2, 3\n"
    (tmp_path / "a.inp").write_text(data)
    actions: list[str] = []
    assert read_surface(tmp_path / "a.inp", "m", actions).n_triangles == 1
    assert actions == ["left out cells that are no faces: 1 of kind tetra"]


@pytest.mark.parametrize(
    ("data", "sets"),
    [
        (SQUARE + "*ELEMENT,\n  TYPE=S4,\nELSET=A\n1, 1, 2, 3, 4\n", {"A": 4}),
        ("*NODE\n1, , 0.\n2, 1., 0,\n3, 1.0D0, 1.d0\n4, , 1.\n", {}),
        (SQUARE + "*NSET, NSET=Rim\n1, 2\n*Nset, nset=RIM\n3\n*NSET, NSET=Both\nrim, 4\n", {"Rim": 3, "Both": 4}),
        (SQUARE + "*NSET, NSET=N, ELSET=a\n*ELEMENT, TYPE=S3, ELSET=A\n7, 1, 2, 3\n", {"N": 3, "A": 3}),
        (SQUARE + "*SYSTEM\n*NODE PRINT, NSET=X\nU\n*SHELL SECTION, ELSET=A\n1.\n", {}),
    ],
)  # fmt: skip
def test_what_its_solvers_read_otherwise_than_it_looks_is_read_as_they_do(
    tmp_path: Path, data: str, sets: dict[str, int]
) -> None:
    if "*ELEMENT" not in data:
        data += "*ELEMENT, TYPE=S4\n1, 1, 2, 3, 4\n"
    elif "S4" not in data:
        data += "*ELEMENT, TYPE=S3\n8, 1, 3, 4\n"
    mesh = read(tmp_path, data, "a.inp")
    np.testing.assert_array_equal(mesh.vertices_m, np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * 1e-3)  # type: ignore[attr-defined]
    assert {name: len(members) for name, members in mesh.vertex_sets.items()} == sets  # type: ignore[attr-defined]


def _cut(data: bytes) -> bytes:
    return data[: int(len(data) * 0.6)]


MSH = gmsh22(TUBE, False)
MSH41 = gmsh41(TUBE, True)
ELEMENTS = "*ELEMENT, TYPE=S3\n1, 1, 2, 3\n"
_LINES = MSH.split(b"\n")
_FIRST_NODE = _LINES.index(b"$Nodes") + 2
_FIRST_ELEMENT = _LINES.index(b"$Elements") + 2


def _msh(line: int, change: Callable[[list[bytes]], list[bytes]]) -> Callable[[], bytes]:
    """Return what makes a file of Gmsh 2.2 in which the words of a line are others."""
    return lambda: b"\n".join([*_LINES[:line], b" ".join(change(_LINES[line].split())), *_LINES[line + 1 :]])


def _more(by: int) -> Callable[[list[bytes]], list[bytes]]:
    return lambda row: [b"%d" % (int(row[0]) + by)]


BAD: dict[str, tuple[str, Callable[[], bytes] | str, str]] = {
    "msh cut off": ("a.msh", lambda: _cut(MSH), "the file is cut off, it does not end with a '\\$End'"),
    "binary msh cut off": ("a.msh", lambda: _cut(MSH41), "a.msh: "),
    "msh of another version": (
        "a.msh", lambda: MSH.replace(b"2.2 0 8", b"9.9 0 8"),
        "Gmsh's version 9.9, readable: 2.0",
    ),
    "msh without a version": ("a.msh", "$MeshFormat\n$EndMeshFormat\n", "does not say its version"),
    "msh of Ansys": ("a.msh", '(0 "fluent")\n(2 3)\n', "does not begin as a MSH file does"),
    "msh of nothing": ("a.msh", "", "the file is empty"),
    "msh without cells": (
        "a.msh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1\n1 0 0 0\n$EndNodes\n", "no triangle or quadrilateral"
    ),
    "msh with a NaN": ("a.msh", lambda: MSH.replace(b"\n2 ", b"\n2 nan ", 1), "a.msh: "),
    "msh with too few nodes": ("a.msh", _msh(_FIRST_NODE - 1, _more(5)), "line 143: \\$Nodes ends before all"),
    "msh with too many nodes": ("a.msh", _msh(_FIRST_NODE - 1, _more(-5)), "line 138: is more than \\$Nodes announces"),
    "msh with too few elements": ("a.msh", _msh(_FIRST_ELEMENT - 1, _more(1)), "line 398: \\$Elements ends before"),
    "msh with too many elements": ("a.msh", _msh(_FIRST_ELEMENT - 1, _more(-1)), "line 397: is more than \\$Elements"),
    "msh with a node twice": (
        "a.msh", _msh(_FIRST_NODE + 1, lambda row: [b"1", *row[1:]]),
        "line 12: node 1 is there twice",
    ),
    "msh with a word": ("a.msh", _msh(_FIRST_NODE, lambda row: [*row[:3], b"x"]), "line 11: 'x' is no coordinate"),
    "msh with a cut node": ("a.msh", _msh(_FIRST_NODE, lambda row: row[:3]), "line 11: a node has 2 coordinates"),
    "msh with a cut element": (
        "a.msh", _msh(_FIRST_ELEMENT, lambda row: row[:-1]),
        "line 146: an element of type 2 has 2 nodes, not 3",
    ),
    "msh with a stranger": (
        "a.msh", _msh(_FIRST_ELEMENT, lambda row: [*row[:-1], b"999"]),
        "line 146: an element names node 999, which is not there",
    ),
    "msh of another type": (
        "a.msh", _msh(_FIRST_ELEMENT, lambda row: [row[0], b"77", *row[2:]]),
        "line 146: elements of type 77 are not known",
    ),
    "msh without an end of its nodes": (
        "a.msh", lambda: MSH.replace(b"$EndNodes\n", b""),
        "line 143: '\\$Elements' comes before the end of \\$Nodes",
    ),
    "msh 4.1 with too few nodes": (
        "a.msh", lambda: gmsh41(TUBE, False).replace(b"$Nodes\n1 132", b"$Nodes\n1 133"),
        "line 284: there are 132 nodes, 133 were announced",
    ),
    "msh 4.1 with a stranger": (
        "a.msh", lambda: gmsh41(TUBE, False).replace(b"\n2 1 0 132\n1\n", b"\n2 1 0 132\n999\n"),
        "an element names node 1, which is not there",
    ),
    "vtu cut off": ("a.vtu", lambda: _cut(vtu(TUBE)), "the file is cut off"),
    "vtu of no cells": (
        "a.vtu",
        '<VTKFile type="UnstructuredGrid" version="0.1"><UnstructuredGrid><Piece NumberOfPoints="0" NumberOfCells="0">'
        "</Piece></UnstructuredGrid></VTKFile>",
        "a.vtu: ",
    ),
    "inp cut off in a node": (
        "a.inp", "*NODE\n1, 0, 0, 0\n2, 1\n",
        "line 3: node 2 has 1 coordinates: is the line cut off",
    ),
    "inp cut off in an element": (
        "a.inp", SQUARE + "*ELEMENT, TYPE=S4\n1, 1, 2,\n",
        "line 7: the last element of type S4",
    ),
    "inp without elements": ("a.inp", SQUARE, "holds no triangle or quadrilateral"),
    "inp of solids": (
        "a.inp", SQUARE + "*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n",
        "no triangle or quadrilateral, but cells: 1 of kind tetra",
    ),
    "inp of an unknown type": (
        "a.inp", SQUARE + "*ELEMENT, TYPE=U1\n1, 1\n",
        "line 6: elements of type 'U1' are not known",
    ),
    "inp with a word": (
        "a.inp", SQUARE + "*ELEMENT, TYPE=S3\n1, one, 2, 3\n",
        "line 7: 'one' is no number of a node",
    ),
    "inp with a NaN": ("a.inp", "*NODE\n1, nan, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n" + ELEMENTS, "vertex 0 is not finite"),
    "inp with a node too much": (
        "a.inp", SQUARE + "*ELEMENT, TYPE=S3\n1, 1, 2, 9\n",
        "element 1 names node 9, which is not",
    ),
    "inp of two parts": ("a.inp", SQUARE + SQUARE + ELEMENTS, "line 7: node 1 is there twice"),
    "inp that includes": (
        "a.inp", SQUARE + "*INCLUDE, INPUT=/etc/passwd\n" + ELEMENTS,
        "line 6: \\*INCLUDE includes another file",
    ),
    "inp with a moved part": (
        "a.inp", SQUARE + "*INSTANCE, NAME=A\n1, 0, 0\n" + ELEMENTS,
        "line 7: moves an instance",
    ),
    "inp with a set of strangers": ("a.inp", SQUARE + ELEMENTS + "*NSET, NSET=A\n77\n", "'A' names node 77"),
    "inp with a set of itself": ("a.inp", SQUARE + ELEMENTS + "*NSET, NSET=A\nB\n*NSET, NSET=B\nA\n", "holds itself"),
    "inp with a set without end": (
        "a.inp", SQUARE + ELEMENTS + "*NSET, NSET=A, GENERATE\n1, 999999999999\n",
        "line 9: .*has",
    ),
    "inp of a generated mesh": (
        "a.inp", SQUARE + ELEMENTS + "*ELGEN\n1, 5\n",
        "line 8: \\*ELGEN makes or changes nodes or elements",
    ),
    "inp of generated nodes": ("a.inp", SQUARE + "*NGEN\n1, 5\n" + ELEMENTS, "line 6: \\*NGEN makes"),
    "inp in cylindrical coordinates": (
        "a.inp", "*NODE, SYSTEM=C\n" + SQUARE[6:] + ELEMENTS,
        "line 1: \\*NODE, SYSTEM=C gives nodes in cylindrical",
    ),
    "inp with axes of its own": ("a.inp", "*SYSTEM\n1, 0, 0\n" + SQUARE + ELEMENTS, "line 1: \\*SYSTEM gives nodes"),
    "inp with nodes elsewhere": (
        "a.inp", SQUARE + "*NODE, INPUT=more.txt\n" + ELEMENTS,
        "line 6: \\*NODE, INPUT=more.txt reads",
    ),
    "inp with an element twice": (
        "a.inp", SQUARE + ELEMENTS + "*ELEMENT, TYPE=S3\n2, 1, 3, 4\n1, 2, 3, 4\n",
        "line 8: element 1 is there twice",
    ),
    "inp with a number of two": ("a.inp", "*NODE\n1_0, 0, 0, 0\n", "line 2: a node: '1_0' is no whole number"),
    "inp with a place of two": ("a.inp", "*NODE\n1, 1_0, 0, 0\n", "line 2: a node: '1_0' is no number"),
    "inp with a set of no elements": (
        "a.inp", SQUARE + ELEMENTS + "*NSET, NSET=N, ELSET=B\n",
        "line 8: is of the nodes of the element set 'B'",
    ),
    "inp with a set beyond all numbers": (
        "a.inp", SQUARE + ELEMENTS + "*NSET, NSET=A, GENERATE\n1, 99999999999999999999\n", "line 9: ",
    ),
    "inp of words": ("a.inp", "here is a mesh\n*NODE\n1, 0, 0, 0\n", "line 1: comes before any keyword"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_one_sentence_with_file_and_place(tmp_path: Path, case: str) -> None:
    name, data, said = BAD[case]
    with pytest.raises(MeshError, match=said) as caught:
        read(tmp_path, data() if callable(data) else data, name)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert "\n" not in str(caught.value)
    assert "Traceback" not in str(caught.value)
