"""Surface files as other programs and other users leave them: read rightly, or refused in one sentence."""

import codecs
import os
import re

import pytest

from tests.other_user import NOBODY, everybodys, needs_other_user
from trocar.services.mechanics.surface.mesh import triangle_areas_m2
from trocar.services.meshes.cached import load_mesh
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.reading import read_surface

pytest.importorskip("trimesh", reason="the mesh extra is not installed")

__all__ = ["everybodys"]


def test_a_face_that_counts_back_means_the_vertices_above_it(tmp_path):
    """It was counted from the file's last vertex: of two squares only the second was there, twice."""
    path = tmp_path / "back.obj"
    squares = ["".join(f"v {x + a} {y} 0\n" for a, y in ((0, 0), (1, 0), (1, 1), (0, 1))) for x in (0, 1)]
    path.write_text(f"{squares[0]}f -4 -3 -2 -1\n{squares[1]}f -4 -3 -2 -1\n")
    mesh = read_surface(path, "m")
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    assert triangle_areas_m2(mesh).sum() == pytest.approx(2.0)


def test_vertices_of_an_obj_keep_their_numbers_whatever_else_a_face_names(tmp_path):
    path = tmp_path / "textured.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nf 3/2 4/1 1/1\nf 3/1 1/1 2/2\n")
    mesh = read_surface(path, "m")
    assert mesh.vertices_m.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.triangles.tolist() == [[2, 3, 0], [2, 0, 1]]


@pytest.mark.parametrize(
    "as_bytes",
    [
        lambda text: codecs.BOM_UTF8 + text.encode(),
        lambda text: text.encode("utf-16"),
        lambda text: text.replace("\n", "\r").encode(),
        lambda text: text.replace("\n", "\r\n").encode(),
        lambda text: text.replace("\n", " # said\n").encode(),
    ],
    ids=["byte order mark", "UTF-16", "carriage returns", "both", "comments"],
)
def test_an_obj_of_any_editor_is_read(tmp_path, as_bytes):
    path = tmp_path / "edited.obj"
    path.write_bytes(as_bytes("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"))
    assert read_surface(path, "m").vertices_m.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("v 0,5 0 0", "line 4: '0,5 0 0' are not three coordinates"),
        ("v 0 0", "line 4: '0 0' are not three coordinates"),
        ("f 1 2 99999999999999999999", "line 4: a face names vertex '99999999999999999999', the file has 3"),
    ],
)
def test_what_is_no_vertex_and_no_face_of_an_obj_is_refused_with_its_line(tmp_path, line, sentence):
    path = tmp_path / "wrong.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\nf 1 2 3\n")
    with pytest.raises(MeshError, match=re.escape(f"wrong.obj: {sentence}")):
        read_surface(path, "m")


def test_what_vtk_finds_wrong_is_one_sentence(tmp_path, capfd):
    path = tmp_path / "other.vtp"
    path.write_text('<VTKFile type="StructuredGrid" version="0.1"><StructuredGrid></StructuredGrid></VTKFile>')
    with pytest.raises(MeshError, match=r"other.vtp: not a readable .* \(Cannot find PolyData element in file\)$"):
        read_surface(path, "m")
    assert capfd.readouterr() == ("", "")


@needs_other_user
def test_a_surface_that_this_user_may_not_read_is_one_sentence(everybodys):
    (everybodys / "closed").mkdir(mode=0o700)
    for path in (everybodys / "secret.obj", everybodys / "closed" / "inside.obj"):
        path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        path.chmod(0o600)
        os.seteuid(NOBODY)
        try:
            with pytest.raises(MeshError, match=f"{path.name}: cannot be read: Permission denied"):
                read_surface(path, "m")
        finally:
            os.seteuid(0)


def test_what_is_no_file_is_called_that(tmp_path):
    (tmp_path / "folder.stl").mkdir()
    os.mkfifo(tmp_path / "pipe.stl")
    for name, sentence in (
        ("folder.stl", "is a folder, not a file"),
        ("pipe.stl", "is a device or a pipe, not a file"),
        (f"{'a' * 300}.stl", "cannot be read: File name too long"),
        ("null\0.stl", "cannot be read: "),  # then the words of this Python
    ):
        for read in (read_surface, load_mesh):
            with pytest.raises(MeshError, match=re.escape(f"{name}: {sentence}")):
                read(tmp_path / name, "m")
