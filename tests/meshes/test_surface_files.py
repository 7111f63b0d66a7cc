"""Surface files to ducts: what is read, what is repaired and said, what is refused with its place."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.fem import ShellModel, ShellSection, clamp, compute_modes
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    smallest_angles_rad,
    triangle_areas_m2,
    unique_edges,
)
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.meshes.cached import load_mesh
from trocar.services.meshes.checking import check_surface
from trocar.services.meshes.crossings import crossing_triangles
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.loading import SurfaceSettings, load_duct_surface
from trocar.services.meshes.openings import enclosed_volume_m3, find_openings, lumen_diameter_m
from trocar.services.meshes.reading import read_surface
from trocar.services.meshes.remeshing import remesh
from trocar.services.meshes.repairing import repair_surface
from trocar.studies.fem.loads import point_load

trimesh = pytest.importorskip("trimesh", reason="the mesh extra is not installed")

ANATOMY = Path(__file__).resolve().parents[3] / "shared" / "data" / "anatomy" / "aorta-surface-open-ends.stl"
R, L = 4e-3, 40e-3
CONE = parametric_duct(DuctGeometry(R, L, 24, 40, taper=0.3))


def save(mesh, path, scale=1.0):
    if path.suffix == ".vtp":
        import pyvista

        pyvista.PolyData.from_regular_faces(scale * mesh.vertices_m, mesh.triangles).save(path)
    else:
        trimesh.Trimesh(scale * mesh.vertices_m, mesh.triangles, process=False).export(path)
    return path


def joined(*meshes):
    offsets = np.cumsum([0, *(m.n_vertices for m in meshes)])
    return TriangleMesh(
        np.concatenate([m.vertices_m for m in meshes]),
        np.concatenate([m.triangles + k for m, k in zip(meshes, offsets, strict=False)]),
    )


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".vtp"])
@pytest.mark.parametrize(("units", "scale"), [("mm", 1e3), ("m", 1.0)])
def test_every_format_gives_the_same_duct(tmp_path, suffix, units, scale):
    path = save(CONE, tmp_path / f"duct{suffix}", scale)
    duct = load_duct_surface(path, SurfaceSettings(units))
    assert (duct.mesh.n_vertices, duct.mesh.n_triangles) == (CONE.n_vertices, CONE.n_triangles)
    assert enclosed_volume_m3(duct.mesh) == pytest.approx(enclosed_volume_m3(CONE), rel=1e-5)
    clamped, mouth = (duct.mesh.vertices_m[duct.mesh.vertex_sets[name]] for name in ("clamped", "mouth"))
    assert np.abs(clamped[:, 0]).max() < 1e-7
    assert np.abs(mouth[:, 0] - L).max() < 1e-7
    assert np.hypot(*mouth[:, 1:].T) == pytest.approx(np.full(24, 0.7 * R), rel=1e-4)


def test_openings_are_named_by_width_and_measured():
    wide, narrow = find_openings(CONE)
    assert (wide.name, narrow.name) == ("end_0", "end_1")
    polygon = np.sqrt(24 / (2 * np.pi) * np.sin(2 * np.pi / 24))
    assert wide.diameter_m == pytest.approx(2 * R * polygon, rel=1e-9)
    assert wide.direction == pytest.approx([-1, 0, 0], abs=1e-12)
    assert narrow.direction == pytest.approx([1, 0, 0], abs=1e-12)
    assert narrow.centre_m == pytest.approx([L, 0, 0], abs=1e-12)


def test_ends_may_have_names_and_a_narrow_one_that_has_a_name_is_no_hole(tmp_path):
    narrow = parametric_duct(DuctGeometry(R, L, 24, 40, taper=0.85))
    path = save(narrow, tmp_path / "duct.stl")
    with pytest.raises(MeshError, match="it has: end_0 at"):
        load_duct_surface(path, SurfaceSettings("m"))
    duct = load_duct_surface(path, SurfaceSettings("m", ("neck",), "tip", names=("neck", "tip")))
    assert [opening.name for opening in duct.openings] == ["neck", "tip"]
    assert set(duct.mesh.vertex_sets) == {"neck", "tip", "clamped", "mouth"}
    with pytest.raises(MeshError, match="2 open ends need as many different names, got: neck, neck"):
        load_duct_surface(path, SurfaceSettings("m", ("neck",), "neck", names=("neck", "neck")))


def test_what_is_up_in_the_file_is_up_in_the_scene(tmp_path):
    path = save(CONE, tmp_path / "duct.stl")
    up = np.array([0.3, -0.8, 0.52])
    duct = load_duct_surface(path, SurfaceSettings("m", up=tuple(up)))
    as_in_file = load_duct_surface(path, SurfaceSettings("m")).mesh.vertices_m
    across = up - np.array([up[0], 0.0, 0.0])
    z = across / np.linalg.norm(across)
    assert duct.mesh.vertices_m[:, 2] == pytest.approx(as_in_file @ z, abs=1e-7)
    assert duct.mesh.vertices_m[:, 0] == pytest.approx(as_in_file[:, 0], abs=1e-9)


def test_volume_with_capped_ends_is_the_cone():
    frustum = np.pi * L / 3 * R**2 * (1 + 0.7 + 0.49)
    fine = parametric_duct(DuctGeometry(R, L, 200, 20, taper=0.3))
    assert enclosed_volume_m3(fine) == pytest.approx(frustum, rel=1e-3)


def test_lumen_is_measured_inside_the_widest_end():
    fine = parametric_duct(DuctGeometry(R, L, 120, 60, taper=0.3))
    one_width_in = 2 * R * (1 - 0.3 * 2 * R / L)
    assert lumen_diameter_m(fine) == pytest.approx(one_width_in, rel=2e-3)


def test_scaling_gives_the_wanted_lumen(tmp_path):
    path = save(CONE, tmp_path / "duct.stl")
    duct = load_duct_surface(path, SurfaceSettings("m", lumen_diameter_m=9e-3))
    assert lumen_diameter_m(duct.mesh) == pytest.approx(9e-3, rel=1e-6)


def test_edge_length_is_that_of_the_scaled_duct(tmp_path):
    path = save(CONE, tmp_path / "duct.stl")
    duct = load_duct_surface(path, SurfaceSettings("m", lumen_diameter_m=14e-3, edge_m=2e-3))
    edges, _ = unique_edges(duct.mesh)
    lengths = np.linalg.norm(duct.mesh.vertices_m[edges[:, 0]] - duct.mesh.vertices_m[edges[:, 1]], axis=1)
    assert np.median(lengths) == pytest.approx(2e-3, rel=0.1)


def test_a_surface_wound_inwards_is_turned_out():
    repaired = repair_surface(TriangleMesh(CONE.vertices_m, CONE.triangles[:, ::-1]))
    assert enclosed_volume_m3(repaired.mesh) > 0
    assert any("face outwards" in action for action in repaired.actions)


def test_mixed_winding_is_made_the_same():
    triangles = CONE.triangles.copy()
    triangles[::3] = triangles[::3, ::-1]
    mixed = TriangleMesh(CONE.vertices_m, triangles)
    assert any("wound against" in finding.defect for finding in check_surface(mixed))
    repaired = repair_surface(mixed)
    assert enclosed_volume_m3(repaired.mesh) == pytest.approx(enclosed_volume_m3(CONE), rel=1e-9)


def test_flat_and_double_triangles_are_dropped():
    triangles = np.vstack([CONE.triangles, CONE.triangles[:3], [[5, 5, 6]]])
    repaired = repair_surface(TriangleMesh(CONE.vertices_m, triangles))
    assert repaired.mesh.n_triangles == CONE.n_triangles
    assert any("dropped 4 triangles" in action for action in repaired.actions)


def test_a_pinhole_is_closed_and_reported_with_its_place():
    pricked = TriangleMesh(CONE.vertices_m, np.delete(CONE.triangles, 700, axis=0))
    repaired = repair_surface(pricked)
    assert len(boundary_loops(repaired.mesh)) == 2
    place_mm = 1e3 * CONE.vertices_m[CONE.triangles[700]].mean(axis=0)
    assert any("closed a hole" in a and str(np.round(place_mm, 2).tolist()) in a for a in repaired.actions)


def test_dust_is_dropped_and_a_fin_is_cut_off():
    dust = TriangleMesh(np.array([[0.1, 0, 0], [0.1, 1e-4, 0], [0.1, 0, 1e-4]]), np.array([[0, 1, 2]]))
    fin = np.array([[0, 0, 3 * R]]) + CONE.vertices_m[400]
    with_fin = TriangleMesh(np.vstack([CONE.vertices_m, fin]), np.vstack([CONE.triangles, [400, 401, CONE.n_vertices]]))
    assert "1 edges shared by more than two triangles" in str(check_surface(with_fin)[0])
    repaired = repair_surface(joined(with_fin, dust))
    assert repaired.mesh.n_triangles == CONE.n_triangles
    assert triangle_areas_m2(repaired.mesh).sum() == pytest.approx(triangle_areas_m2(CONE).sum(), rel=1e-9)


def far(mesh, distance_m):
    return TriangleMesh(mesh.vertices_m + np.array([distance_m, 0.0, 0.0]), mesh.triangles)


def crossing_tubes():
    """A tube whose own wall is pushed through its other side."""
    vertices = CONE.vertices_m.copy()
    pushed = np.hypot(vertices[:, 0] - 0.5 * L, vertices[:, 1] - R) < 2.5e-3
    vertices[pushed, 1] -= 2.5 * R
    return TriangleMesh(vertices, CONE.triangles)


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("size", [1.0, 0.01])
def test_a_needle_through_a_triangle_is_found_whichever_is_larger(swap, size):
    """The needle's edge pierces the triangle; none of the triangle's edges pierces the needle."""
    plate = size * np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1.5, 0]])
    needle = 0.1 * np.array([[0.0, 0, -1], [0.01, 0, 1], [0, 0.01, 1]]) * [min(size, 1), min(size, 1), 1]
    parts = [needle, plate] if swap else [plate, needle]
    apart = np.array([[5.0, 0, 0], [6, 0, 0], [5, 1, 0]])
    mesh = TriangleMesh(np.concatenate([*parts, apart]), np.arange(9).reshape(3, 3))
    assert crossing_triangles(mesh).tolist() == [0, 1]


def test_cuts_are_searched_on_the_surface_that_is_used_alone(tmp_path):
    """On the source of another they took a minute; what is made of it is searched, and refused."""
    assert repair_surface(crossing_tubes(), is_used=False).mesh.n_triangles == CONE.n_triangles
    path = save(crossing_tubes(), tmp_path / "cut.stl")
    with pytest.raises(MeshError, match=r"remeshing to edges of 3 mm breaks the surface: .*cut through others"):
        load_duct_surface(path, SurfaceSettings("m", edge_m=3e-3))


def moebius_band():
    u = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.stack([np.cos(u), np.sin(u), 0 * u], 1)
    offset = 0.2 * np.stack([np.cos(u / 2) * np.cos(u), np.cos(u / 2) * np.sin(u), np.sin(u / 2)], 1)
    a = np.arange(40)
    b = np.roll(a, -1)
    low, high = a, a + 40
    next_low, next_high = b.copy(), b + 40
    next_low[-1], next_high[-1] = 40, 0
    triangles = np.concatenate([np.stack([low, next_low, next_high], 1), np.stack([low, next_high, high], 1)])
    return TriangleMesh(np.concatenate([ring - offset, ring + offset]), triangles)


def closed_box():
    box = trimesh.creation.box()
    return TriangleMesh(np.asarray(box.vertices), np.asarray(box.faces))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (closed_box, "no open end, it cannot be a duct"),
        (lambda: joined(far(CONE, 0.2), CONE), r"second piece round \[20\.0, .* mm with 50 % of its area"),
        (crossing_tubes, r"triangles that cut through others, the first at \[\d+\.\d+, .* mm"),
        (moebius_band, "one side only"),
        (lambda: TriangleMesh(np.zeros((3, 3)), np.array([[0, 1, 2]])), "no triangle with an area"),
    ],
)
def test_what_cannot_be_repaired_is_refused_with_the_reason(build, message):
    with pytest.raises(MeshError, match=message):
        repair_surface(build())


def test_sheets_that_touch_in_a_vertex_are_refused_with_the_place():
    """Two opposite places of the wall glued at one vertex: every edge is sound, the shell is not."""
    kept, glued = 20 * 24, 20 * 24 + 12
    touching = TriangleMesh(CONE.vertices_m, np.where(CONE.triangles == glued, kept, CONE.triangles))
    with pytest.raises(
        MeshError, match=r"1 vertices where separate sheets touch, the first at \[20\.0, 3\.4, 0\.0\] mm"
    ):
        repair_surface(touching)


def test_a_clean_surface_has_no_findings():
    assert check_surface(CONE) == []
    assert len(crossing_triangles(CONE)) == 0


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".vtp"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff\x01 not a mesh", b"solid x\nfacet normal nan nan nan\n"])
def test_broken_files_are_refused_by_name(tmp_path, suffix, content, capfd):
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    with pytest.raises(MeshError, match=f"broken{suffix}"):
        read_surface(path, "mm")


@pytest.mark.parametrize(
    ("face", "vertex"),
    [("1 2 7", "7"), ("0 1 2", "0"), ("-4 -2 -3", "-4"), ("1//1 2//1 9//1", "9"), ("1 2 x", "x"), ("1 2 2.5", "2.5")],
)
def test_an_obj_whose_face_names_no_vertex_is_refused_with_its_line(tmp_path, face, vertex):
    """Zero was taken for another vertex, and answered; the others were told in the words of an array."""
    path = tmp_path / "named.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/2 3/3\nf {face}\n")
    with pytest.raises(MeshError, match=re.escape(f"line 5: a face names vertex '{vertex}', the file has 3")):
        read_surface(path, "mm")


@pytest.mark.parametrize("face", ["1 2 3", "-3 -2 -1", "1//1 2//1 3//1", "1/1/1 2/2/1 3/3/1", "1 2 \\\n3"])
def test_an_obj_may_name_its_vertices_in_every_way_there_is(tmp_path, face):
    path = tmp_path / "named.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nf {face}\n")
    assert len(read_surface(path, "mm").triangles) == 1


@pytest.mark.parametrize(
    ("name", "units", "message"),
    [("absent.stl", "mm", "no such file"), ("x.step", "mm", "cannot read '.step'"), ("x.stl", "ft", "unknown units")],
)
def test_wrong_names_and_units_are_refused(tmp_path, name, units, message):
    with pytest.raises(MeshError, match=message):
        read_surface(tmp_path / name, units)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mouth": "end_7"}, r"duct.stl: surface has no open end 'end_7'; it has: end_0 at .* mm, 8.0 mm wide"),
        ({"mouth": "end_0"}, "cannot be the mouth and clamped"),
        ({"lumen_diameter_m": -1.0}, "lumen_diameter_m must be positive"),
        ({"edge_m": 0.0}, "edge_m must be positive"),
        ({"edge_m": 30e-3}, "edges of 30 mm are too long"),
    ],
)
def test_wrong_settings_are_refused_by_name(tmp_path, change, message):
    path = save(CONE, tmp_path / "duct.stl")
    with pytest.raises(MeshError, match=message):
        load_duct_surface(path, SurfaceSettings("m", **change))


def test_slivers_are_refused_unless_remeshed(tmp_path):
    vertices = CONE.vertices_m.copy()
    vertices[500] = vertices[501] + 1e-5 * (vertices[500] - vertices[501])
    path = save(TriangleMesh(vertices, CONE.triangles), tmp_path / "sliver.ply")
    with pytest.raises(MeshError, match=r"sliver.ply: triangle \d+ at .* has an angle"):
        load_duct_surface(path, SurfaceSettings("m"))
    duct = load_duct_surface(path, SurfaceSettings("m", edge_m=1e-3))
    assert smallest_angles_rad(duct.mesh).min() > np.radians(20)


def test_remeshing_is_even_faithful_and_repeatable():
    new, again = remesh(CONE, 1.2e-3), remesh(CONE, 1.2e-3)
    assert np.array_equal(new.vertices_m, again.vertices_m)
    assert np.array_equal(new.triangles, again.triangles)
    edges, _ = unique_edges(new)
    lengths = np.linalg.norm(new.vertices_m[edges[:, 0]] - new.vertices_m[edges[:, 1]], axis=1)
    assert np.median(lengths) == pytest.approx(1.2e-3, rel=0.1)
    assert lengths.max() < 2 * lengths.min() * 1.5
    assert triangle_areas_m2(new).sum() == pytest.approx(triangle_areas_m2(CONE).sum(), rel=0.06)


@pytest.mark.parametrize(
    ("n_around", "n_along", "edge_m"),
    by_day(
        [(200, 180, 2e-3), (120, 400, 3e-3), (240, 60, 4e-3)],
        [(200, 180, 3e-3), (200, 180, 4e-3), (120, 400, 2e-3), (120, 400, 4e-3), (240, 60, 2e-3), (240, 60, 3e-3)],
    ),
)
def test_a_scan_far_finer_than_the_wanted_edge_keeps_its_shape(n_around, n_along, edge_m):
    """Of straight walls, whose edges a decimation would collapse to triangles as long as the wall."""
    fine = parametric_duct(DuctGeometry(R, L, n_around, n_along))
    new = remesh(fine, edge_m)
    assert new.n_triangles == pytest.approx(4.0 / np.sqrt(3.0) * triangle_areas_m2(fine).sum() / edge_m**2, rel=0.1)
    from_axis_m = np.linalg.norm(new.vertices_m[:, 1:], axis=1)
    assert (np.abs(from_axis_m - R) < edge_m**2 / (4.0 * R)).all()
    assert smallest_angles_rad(new).min() > np.radians(20)


def test_the_cache_gives_the_same_mesh_without_reading_the_surface_again(tmp_path, monkeypatch):
    path = save(CONE, tmp_path / "duct.stl", 1e3)
    first = load_mesh(path, "mm", edge_m=1.5e-3, cache_dir=tmp_path)
    monkeypatch.setattr("trocar.services.meshes.cached.load_duct_surface", None)
    again = load_mesh(path, "mm", edge_m=1.5e-3, cache_dir=tmp_path)
    assert np.array_equal(first.vertices_m, again.vertices_m)
    assert np.array_equal(first.triangles, again.triangles)
    assert {k: v.tolist() for k, v in first.vertex_sets.items()} == {
        k: v.tolist() for k, v in again.vertex_sets.items()
    }


@pytest.mark.parametrize(
    "change", [{"edge_m": 2e-3}, {"lumen_diameter_m": 7e-3}, {"mouth": "end_0", "clamped": ("end_1",)}]
)
def test_the_cache_knows_other_settings_apart(tmp_path, change):
    path = save(CONE, tmp_path / "duct.stl", 1e3)
    usual = {"units": "mm", "edge_m": 1.5e-3, "cache_dir": tmp_path}
    first, other = load_mesh(path, **usual), load_mesh(path, **(usual | change))
    assert not np.array_equal(first.vertices_m, other.vertices_m)


def test_the_cache_refuses_what_loading_refuses(tmp_path):
    with pytest.raises(MeshError, match="no such file"):
        load_mesh(tmp_path / "absent.stl", "mm", cache_dir=tmp_path)
    path = save(CONE, tmp_path / "duct.stl", 1e3)
    with pytest.raises(MeshError, match="no open end 'end_5'"):
        load_mesh(path, "mm", mouth="end_5", cache_dir=tmp_path)


def test_a_scan_much_finer_than_wanted_is_remeshed_all_the_same():
    scan = parametric_duct(DuctGeometry(R, L, 160, 180, taper=0.3))
    coarse = remesh(scan, 2e-3)
    assert coarse.n_triangles < 700
    assert enclosed_volume_m3(coarse) == pytest.approx(enclosed_volume_m3(scan), rel=0.15)


@pytest.fixture(scope="module")
def anatomy():
    if not ANATOMY.is_file():
        pytest.skip(f"{ANATOMY} is not there")
    return load_duct_surface(ANATOMY, SurfaceSettings("mm", edge_m=1.5e-3, lumen_diameter_m=9e-3))


def test_anatomy_as_scanned_is_refused_for_its_slivers():
    if not ANATOMY.is_file():
        pytest.skip(f"{ANATOMY} is not there")
    with pytest.raises(MeshError, match="give edge_m to remesh"):
        load_duct_surface(ANATOMY, SurfaceSettings("mm", lumen_diameter_m=9e-3))


def test_anatomy_loads_clean_with_three_ends(anatomy):
    assert check_surface(anatomy.mesh) == []
    assert [opening.name for opening in anatomy.openings] == ["end_0", "end_1", "end_2"]
    assert lumen_diameter_m(anatomy.mesh) == pytest.approx(9e-3, rel=0.03)
    assert smallest_angles_rad(anatomy.mesh).min() > np.radians(20)


def test_anatomy_has_finite_positive_frequencies_and_balanced_statics(anatomy):
    model = ShellModel(anatomy.mesh, ShellSection(0.8e-3, 100e3, 0.45, 1060.0), [clamp(anatomy.mesh)])
    frequency = compute_modes(model, 40).frequency_hz
    assert np.isfinite(frequency).all()
    assert frequency[0] > 1.0
    push = point_load(anatomy.mesh, int(anatomy.mesh.vertex_sets["mouth"][0]), np.array([0.0, 1e-3, 0.0]))
    solution = model.solve_static(push)
    assert solution.residual < 1e-8
    assert solution.reaction[:, :3].sum(axis=0) == pytest.approx([0, -1e-3, 0], abs=1e-11)
