"""What is judged of a surface file before it is read, repaired, remeshed or solved: whole, its unit, its size."""

import resource
import subprocess
import sys
from typing import get_args

import pytest

from trocar.services.mechanics.fem.memory import solve_bytes
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.mechanics.surface.units import METRES_PER_UNIT, LengthUnit
from trocar.services.meshes.announced import MOST_TRIANGLES_READ
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.loading import SurfaceSettings, load_duct_surface
from trocar.services.meshes.reading import read_surface

trimesh = pytest.importorskip("trimesh", reason="the mesh extra is not installed")

TUBE = parametric_duct(DuctGeometry(4e-3, 40e-3, 16, 20))


def save(path, scale=1.0):
    trimesh.Trimesh(scale * TUBE.vertices_m, TUBE.triangles, process=False).export(path)
    return path


@pytest.mark.parametrize("edge_m", [None, 0.5e-3])
def test_millimetres_declared_as_metres_are_refused_with_the_unit_that_fits(tmp_path, edge_m):
    """With edge_m this once took 21 GB."""
    path = save(tmp_path / "tube.stl", 1e3)
    with pytest.raises(
        MeshError,
        match=r"tube.stl: with units 'm' the surface is 41.6 m .*: .*in mm it would be 41.6 mm, in in it would",
    ):
        load_duct_surface(path, SurfaceSettings("m", edge_m=edge_m))
    load_duct_surface(path, SurfaceSettings("mm"))
    load_duct_surface(path, SurfaceSettings("m", lumen_diameter_m=8e-3))


def test_metres_declared_as_micrometres_are_refused(tmp_path):
    with pytest.raises(MeshError, match=r"with units 'um' the surface is 4.16e-08 m .*in m it would be 41.6 mm"):
        load_duct_surface(save(tmp_path / "tube.stl"), SurfaceSettings("um"))


def test_an_edge_that_makes_too_many_triangles_is_refused_with_their_number(tmp_path):
    with pytest.raises(
        MeshError, match=r"edges of 0.01 mm make about 2.3e\+07 triangles .* take 7.\de\+02 GB to solve; at most 200000"
    ):
        load_duct_surface(save(tmp_path / "tube.stl"), SurfaceSettings("m", edge_m=1e-5))


def announce(path, triangles, held):
    """A binary STL that says how many triangles it has, with room for those it holds; sparse on the disk."""
    with path.open("wb") as file:
        file.write(b"\0" * 80 + triangles.to_bytes(4, "little"))
        file.truncate(84 + 50 * held)
    return path


def test_a_scan_of_millions_is_refused_before_it_is_read(tmp_path):
    assert MOST_TRIANGLES_READ < 5_000_000
    with pytest.raises(MeshError, match=r"scan.stl: about 5e\+06 triangles, which take 5 GB to repair; at most 2e\+06"):
        read_surface(announce(tmp_path / "scan.stl", 5_000_000, 5_000_000), "mm")
    (tmp_path / "scan.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\nelement face 7000000\nend_header\n")
    with pytest.raises(MeshError, match=r"scan.ply: about 7e\+06 triangles"):
        read_surface(tmp_path / "scan.ply", "mm")


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".vtp"])
def test_an_empty_file_is_called_empty(tmp_path, suffix, capfd):
    path = tmp_path / f"nothing{suffix}"
    path.touch()
    with pytest.raises(MeshError, match=rf"nothing{suffix}: the file is empty$"):
        read_surface(path, "mm")
    assert capfd.readouterr() == ("", "")


def cut(path, keep):
    path.write_bytes(path.read_bytes()[: int(keep * path.stat().st_size)])
    return path


def test_a_file_that_is_cut_off_is_called_that(tmp_path, capfd):
    pyvista = pytest.importorskip("pyvista", reason="the mesh extra is not installed")
    binary = cut(save(tmp_path / "binary.stl"), 0.5)
    with pytest.raises(MeshError, match=r"binary.stl: the file is cut off, it announces 640 triangles and holds 319"):
        read_surface(binary, "m")
    text = tmp_path / "text.stl"
    text.write_text(trimesh.Trimesh(TUBE.vertices_m, TUBE.triangles, process=False).export(file_type="stl_ascii"))
    assert read_surface(text, "m").n_triangles == 640
    with pytest.raises(MeshError, match=r"text.stl: the file is cut off, it does not end with 'endsolid'"):
        read_surface(cut(text, 0.7), "m")
    pyvista.PolyData.from_regular_faces(TUBE.vertices_m, TUBE.triangles).save(tmp_path / "tube.vtp")
    with pytest.raises(MeshError, match=r"tube.vtp: the file is cut off"):
        read_surface(cut(tmp_path / "tube.vtp", 0.7), "m")
    assert capfd.readouterr() == ("", "")


def test_a_ply_in_text_that_is_cut_off_is_called_that(tmp_path):
    """It lost the faces that were not there without a word."""
    path = tmp_path / "tube.ply"
    surface = trimesh.Trimesh(TUBE.vertices_m, TUBE.triangles, process=False)
    path.write_bytes(surface.export(file_type="ply", encoding="ascii"))
    assert read_surface(path, "m").n_triangles == 640
    path.write_bytes(b"\n".join(path.read_bytes().splitlines()[:-3]) + b"\n")
    with pytest.raises(MeshError, match=r"tube.ply: the file is cut off, it announces 640 faces and holds 637"):
        read_surface(path, "m")


def test_an_stl_with_more_triangles_than_it_announces_says_how_many_bytes(tmp_path):
    path = save(tmp_path / "longer.stl")
    path.write_bytes(path.read_bytes() + path.read_bytes()[84:184])
    with pytest.raises(MeshError, match=r"longer.stl: announces 640 triangles, which take 32084 bytes, and has 32184"):
        read_surface(path, "m")


def test_points_without_triangles_are_called_that(tmp_path):
    path = tmp_path / "points.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    with pytest.raises(
        MeshError, match=r"points.obj: (the file holds no triangles|not a readable triangle surface)"
    ) as told:
        read_surface(path, "m")
    assert "shape" not in str(told.value)


def test_every_unit_is_known_everywhere():
    assert set(get_args(LengthUnit)) == set(METRES_PER_UNIT)


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_AS"), reason="no limit on memory to set here")
def test_a_model_that_does_not_fit_is_refused_before_it_is_assembled():
    """In a process that may take 1 GB more than it has: the model wants 5."""
    script = """
import resource
from pathlib import Path
from trocar.services.mechanics.fem import ShellModel, ShellSection, clamp
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 250, 450))
has = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (has + 10**9, has + 10**9))
ShellModel(mesh, ShellSection(5e-4, 1e5, 0.45, 1060.0), [clamp(mesh)])
"""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    wanted = f"{1e-9 * solve_bytes(250 * 451):.2g}"
    assert f"mesh: 112750 vertices take about {wanted} GB to solve, 1 GB are free" in ran.stderr, ran.stderr


def test_a_duct_that_does_not_fit_is_refused_before_it_is_repaired(tmp_path, monkeypatch):
    """The repair of 720,000 triangles took a minute and a half, and then they were too many."""
    path = save(tmp_path / "tube.stl")
    monkeypatch.setattr("trocar.services.mechanics.fem.memory.free_bytes", lambda: 1000.0)
    monkeypatch.setattr(
        "trocar.services.meshes.loading.repair_surface", lambda *_, **__: pytest.fail("it was repaired")
    )
    with pytest.raises(
        MeshError, match=r"tube.stl: mesh: 320 vertices take .* are free: use larger triangles, or give edge_m to"
    ):
        load_duct_surface(path, SurfaceSettings("m"))


def test_a_duct_of_numbers_has_a_limit_too():
    with pytest.raises(ValueError, match=r"n_around times n_along make 2e\+10 triangles, at most 2e\+06"):
        DuctGeometry(4e-3, 40e-3, 100_000, 100_000)
