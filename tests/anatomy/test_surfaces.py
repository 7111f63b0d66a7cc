"""Surfaces become ducts too: closed ones are cut open, open ones cut square, and axes are kept right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.anatomy.phantoms import Scan, forked, scan, straight
from trocar.services.anatomy.making import AnatomyRequest, make_anatomy
from trocar.services.anatomy.patient_surface import said_axes
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.meshes.errors import MeshError

pytest.importorskip("trimesh", reason="the mesh extra is not installed")

AORTA = Path(__file__).parents[2].parent / "shared" / "data" / "anatomy" / "aorta-surface-open-ends.stl"
RAS = np.array([-1.0, -1.0, 1.0])


def surface_of(known: Scan, cell_m: float = 0.5e-3) -> TriangleMesh:
    """Return the closed surface of tubes by their distance."""
    from trocar.services.meshes.branching import contour_union

    surface = contour_union(known.tubes, cell_m).triangulate()
    return TriangleMesh(np.asarray(surface.points, np.float64), np.asarray(surface.regular_faces, np.int32))


def write(mesh: TriangleMesh, path: Path, scale: np.ndarray | float = 1e3, head: bytes = b"") -> Path:
    import trimesh

    trimesh.Trimesh(scale * mesh.vertices_m, mesh.triangles, process=False).export(path)
    if head:
        whole = path.read_bytes()
        path.write_bytes(head.ljust(80) + whole[80:])
    return path


KNOWN = scan(forked(), (1.0, 1.0, 1.0))


@pytest.fixture(scope="module")
def surface() -> TriangleMesh:
    return surface_of(KNOWN)


def test_a_closed_surface_is_cut_open_at_its_three_ends(surface: TriangleMesh, tmp_path: Path) -> None:
    path = write(surface, tmp_path / "duct.stl")
    anatomy = make_anatomy(path, AnatomyRequest(thickness_m=0.6e-3))
    assert anatomy.names == ["end_0", "end_1", "end_2"]
    off_mm = KNOWN.surface_error_mm(anatomy.duct.mesh.vertices_m)
    assert np.percentile(np.abs(off_mm - 0.3), 95.0) < 0.1


def test_a_surface_that_is_the_middle_of_the_wall_is_not_moved(surface: TriangleMesh, tmp_path: Path) -> None:
    path = write(surface, tmp_path / "duct.ply")
    anatomy = make_anatomy(path, AnatomyRequest(is_middle=True))
    assert np.percentile(KNOWN.surface_error_mm(anatomy.duct.mesh.vertices_m), 95.0) < 0.1


def test_axes_are_those_that_the_file_says(tmp_path: Path) -> None:
    mesh = surface_of(KNOWN, 1e-3)
    coarse = AnatomyRequest(is_middle=True, edge_m=2e-3)
    lps = make_anatomy(write(mesh, tmp_path / "lps.stl"), coarse)
    told = write(mesh, tmp_path / "ras.stl", 1e3 * RAS, b"3D Slicer output. SPACE=RAS")
    assert (said_axes(told), said_axes(tmp_path / "lps.stl")) == ("RAS", "LPS")
    untold = write(mesh, tmp_path / "untold.obj", 1e3 * RAS)
    for other in (make_anatomy(told, coarse), make_anatomy(untold, replace(coarse, axes="RAS"))):
        for mine, theirs in zip(lps.duct.ends, other.duct.ends, strict=True):
            assert theirs.opening.centre_m == pytest.approx(mine.opening.centre_m, abs=0.3e-3)


def test_an_end_that_is_cut_obliquely_becomes_square(tmp_path: Path) -> None:
    oblique = parametric_duct(DuctGeometry(3e-3, 40e-3, 40, 60, cut_angle_rad=0.6))
    anatomy = make_anatomy(write(oblique, tmp_path / "duct.vtp.stl"), AnatomyRequest(is_middle=True))
    for end in anatomy.duct.ends:
        assert abs(end.opening.direction[0]) > np.cos(np.radians(6.0))


def test_labels_are_a_volumes(tmp_path: Path) -> None:
    path = write(surface_of(scan(straight(), (1.0, 1.0, 1.0))), tmp_path / "duct.stl")
    with pytest.raises(MeshError, match="is a surface and has no labels"):
        make_anatomy(path, AnatomyRequest(label="1"))


def test_a_surface_in_another_unit_is_told(surface: TriangleMesh, tmp_path: Path) -> None:
    path = write(surface, tmp_path / "duct.stl", 1.0)
    with pytest.raises(MeshError, match="in m it would be"):
        make_anatomy(path, AnatomyRequest())


def test_a_scanned_vessel_with_branches_becomes_a_duct() -> None:
    if not AORTA.exists():
        pytest.skip(f"needs the scan {AORTA.name}, which is not part of the repository")
    anatomy = make_anatomy(AORTA, AnatomyRequest())
    assert len(anatomy.duct.ends) >= 3
    assert anatomy.duct.moved_m[0] < 0.5e-3
