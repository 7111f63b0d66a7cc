"""The view as by X-rays against closed forms: a ray's way through ball, rod and tube, and Beer and Lambert."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import pyvista as pv

from trocar.review.export import fluoroscopy
from trocar.review.export.fluoroscopy import CATHETER_1_M, STEEL_1_M, WALL_1_M, Fluoroscope, Lens, add_way, rod
from trocar.services.mechanics.scene.instruments import DrawnPart
from trocar.services.visualization.picture import Picture, PictureLayout, ToolShape

AHEAD_M, FOCAL = 0.5, 900.0
SIZE = 121, 81
LENS = Lens(np.array([0.0, 0.0, -AHEAD_M]), np.eye(3), FOCAL)
MIDDLE = SIZE[1] // 2, SIZE[0] // 2


def way_m(points_m, triangles):
    out = np.zeros(SIZE[::-1])
    add_way(LENS.seen_m(np.asarray(points_m, float)), np.asarray(triangles, np.int32), FOCAL, 1.0, out)
    return out


def rays():
    """Directions (h, w, 3) of the rays."""
    j, i = np.indices(SIZE[::-1])
    along = np.stack([(i + 0.5 - SIZE[0] / 2) / FOCAL, (j + 0.5 - SIZE[1] / 2) / FOCAL, np.ones(i.shape)], axis=-1)
    return along / np.linalg.norm(along, axis=-1, keepdims=True)


def across_m(radius_m, axis=None):
    """Closed form: the way of each ray through a ball in the origin, or through an endless rod along an axis."""
    d, start = rays(), LENS.eye_m
    if axis is not None:
        axis = np.asarray(axis) / np.linalg.norm(axis)
        d, start = d - (d @ axis)[..., None] * axis, start - (start @ axis) * axis
    a, b, c = (d * d).sum(-1), d @ start, start @ start - radius_m**2
    return 2.0 * np.sqrt(np.maximum(b * b - a * c, 0.0)) / a


def surface(mesh):
    return mesh.points, mesh.triangulate().faces.reshape(-1, 4)[:, 1:]


def test_a_ball():
    found = way_m(*surface(pv.Icosphere(radius=10e-3, nsub=5)))
    inner = across_m(9e-3) > 0.0
    np.testing.assert_allclose(found[inner], across_m(10e-3)[inner], rtol=5e-3)
    np.testing.assert_allclose(found[MIDDLE], 20e-3, rtol=2e-3)
    assert np.all(found[across_m(10.1e-3) == 0.0] == 0.0)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.5, 1.0, 0.0), (1.0, 0.2, 0.7)])
def test_a_rod_that_leaves_the_picture_at_both_sides(axis):
    line_m = np.linspace(-1.0, 1.0, 90)[:, None] * 0.2 * np.array(axis) / np.linalg.norm(axis)
    found = way_m(*rod(line_m, np.full(90, 8e-3)))
    inner = across_m(6.5e-3, axis) > 0.0
    assert inner.sum() > 1000
    np.testing.assert_allclose(found[inner], across_m(8e-3, axis)[inner], rtol=0.02)
    assert found.min() > -1e-9


def test_no_pixel_is_lost_or_taken_twice_where_corners_and_edges_meet_it():
    """The corners of a cube's triangles lie on middles of pixels: 20 mm are seen everywhere, or nothing."""
    step = AHEAD_M / FOCAL
    cube = pv.Box((-9.0 * step, 10.0 * step, -9.0 * step, 10.0 * step, -1e-2, 1e-2)).triangulate().subdivide(3)
    points_m = cube.points.astype(float)
    points_m[:, :2] *= (AHEAD_M + points_m[:, 2:]) / AHEAD_M  # its sides run with the rays
    found = way_m(points_m, cube.faces.reshape(-1, 4)[:, 1:]) * rays()[..., 2]
    seen = found > 1e-3
    assert seen.sum() == 19 * 19
    np.testing.assert_allclose(found[seen], 20e-3, rtol=1e-6)
    np.testing.assert_allclose(found[~seen], 0.0, atol=1e-12)


def layout(tools=()):
    tube = pv.Cylinder(radius=10e-3, height=80e-3, resolution=120, capping=False).triangulate().subdivide(2).clean()
    points_m, triangles = surface(tube)
    corners = points_m[triangles]
    outwards = np.einsum("ij,ij->i", np.cross(*np.diff(corners, axis=1).transpose(1, 0, 2)), corners[:, 0])
    triangles = np.where(outwards[:, None] > 0.0, triangles, triangles[:, ::-1]).astype(np.int32)
    return PictureLayout(1, "", points_m.astype(np.float32), triangles, 1e-3, (), (), 30, 1.5e-3, tools)


def test_a_picture_is_what_beer_and_lambert_leave_of_wall_catheter_and_tool():
    part = DrawnPart("steel", ((-30e-3, 2e-3), (30e-3, 2e-3)))
    shape = ToolShape("right", (0.0, 0.0, 0.0), 2e-3, (part,))
    picture, grey = Picture(1), {}
    wire = {"n_wire_segments": 17, "wire_radius_m": 0.5e-3}  # the last 35 of 60 mm, beyond the middle
    cases = ("tube", (), False), ("in it", (), True), ("tool", (shape,), False), ("wire", (), True)
    for name, given, catheter in cases:
        made, view = replace(layout(given), **(wire if name == "wire" else {})), Fluoroscope((161, 101))
        picture.points_m = made.rest_m
        picture.centreline_m = np.zeros((0, 3), np.float32)
        picture.poses = np.array([(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)], np.float32)[: len(given)]
        if catheter:
            picture.centreline_m = np.linspace((-30e-3, 0, 0), (30e-3, 0, 0), 30).astype(np.float32)
        view.update(made, picture)
        grey[name] = view.image()
        assert grey[name].shape == (101, 161, 3)
        assert np.all(grey[name][0] == 255)
    wall, middle = np.exp(-WALL_1_M * 2e-3), (50, 80, 0)
    assert abs(grey["tube"][middle] - 255.0 * wall) < 1.0
    assert abs(grey["in it"][middle] - 255.0 * wall * np.exp(-CATHETER_1_M * 3e-3)) < 1.0
    assert abs(grey["wire"][middle] - 255.0 * wall * np.exp(-STEEL_1_M * 1e-3)) < 1.0
    assert {tuple(grey["wire"][50, side]) for side in (40, 120)} > {tuple(grey["in it"][50, 40])}
    assert abs(grey["tool"][middle] - 255.0 * wall * np.exp(-STEEL_1_M * 4e-3)) < 1.0
    rim = grey["tube"][:, 80, 0].min()
    assert abs(rim - 255.0 * np.exp(-WALL_1_M * 2.0 * np.sqrt(10.5e-3**2 - 9.5e-3**2))) < 12.0


def test_the_lens_spreads_out_what_it_sees_and_keeps_it_within_the_picture():
    points_m = np.random.default_rng(2).normal(0.0, 1.0, (400, 3)) * (5e-3, 30e-3, 15e-3)
    lens = fluoroscopy.lens_on(points_m, SIZE)
    seen = lens.seen_m(points_m)
    right, down = (lens.focal * seen[:, :2] / seen[:, 2:]).T
    assert max(2.0 * np.abs(right).max() / SIZE[0], 2.0 * np.abs(down).max() / SIZE[1]) == pytest.approx(0.9)
    assert right.std() > down.std() > 0.0
    assert np.linalg.det(lens.axes) == pytest.approx(1.0)


@pytest.mark.parametrize("spread_m", [(30e-3, 5e-3, 15e-3), (15e-3, 5e-3, 30e-3), (5e-3, 15e-3, 30e-3)])
def test_what_is_up_is_up_in_the_picture_unless_one_looks_from_above(spread_m):
    points_m = np.random.default_rng(2).normal(0.0, 1.0, (400, 3)) * spread_m
    lens = fluoroscopy.lens_on(points_m, SIZE)
    assert np.linalg.det(lens.axes) == pytest.approx(1.0)
    if spread_m.index(max(spread_m)) != 2:
        assert lens.axes[1, 2] < -0.9
    (place,) = lens.seen_m(lens.eye_m[None] + 0.7 * lens.axes[2:])
    np.testing.assert_allclose(place, (0.0, 0.0, 0.7), atol=1e-12)


def test_it_needs_neither_display_nor_pyvista():
    text = "import sys; sys.modules['pyvista'] = None; from trocar.review.export.views import FilmView"
    text += "; print(FilmView.FLUOROSCOPY.open_renderer((8, 6), None).image().shape)"
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run([sys.executable, "-c", text], check=True, capture_output=True, text=True, env=bare)
    assert done.stdout == "(6, 8, 3)\n"
