"""The cholangiogram: cells against volumes, flow against Poiseuille and conservation, rays against closed forms."""

import numpy as np
import pytest

from trocar.review.export.cholangiogram import CONTRAST_1_M, RATE_M3_S, Cholangioscope
from trocar.review.export.contrast_flow import ContrastFlow, FlowChannel, steady_flow
from trocar.review.export.filled_lumen import FilledLumen
from trocar.review.export.lumen_cells import LumenCells
from trocar.services.mechanics.scene.duct_branch import DuctBranch
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.scene.scene_model import DuctScene
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.meshes.branching import branching_mesh
from trocar.services.meshes.openings import enclosed_volume_m3
from trocar.services.visualization.picture import Picture, PictureLayout

RADIUS_M, LENGTH_M, THICKNESS_M = 5e-3, 60e-3, 1e-3
INNER_M = RADIUS_M - 0.5 * THICKNESS_M
AROUND, ALONG = 48, 40


def tube():
    """Vertices and outward triangles of an open tube along x from 0, and the vertices of its rim at x = 0."""
    angle, x = np.meshgrid(2 * np.pi * np.arange(AROUND) / AROUND, np.linspace(0.0, LENGTH_M, ALONG + 1))
    points_m = np.stack([x, RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle)], axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.indices((ALONG, AROUND)))
    a, b = i * AROUND + j, i * AROUND + (j + 1) % AROUND
    triangles = np.concatenate([np.stack([a, b, a + AROUND], 1), np.stack([b, b + AROUND, a + AROUND], 1)])
    return points_m.astype(np.float32), triangles.astype(np.int32), np.arange(AROUND)


def fork():
    """A trunk that parts in a short and a long branch of one width, both open, as the mouth is."""
    branches = tuple(
        DuctBranch(name=name, angle_rad=0.5, azimuth_rad=azimuth, radius_m=2.5e-3, length_m=length_m, end="held")
        for name, azimuth, length_m in (("short", 0.0, 15e-3), ("long", np.pi, 35e-3))
    )
    mesh = branching_mesh(duct_tubes(DuctScene(radius_m=3.5e-3, length_m=20e-3, branches=branches)), 1.2e-3)
    return mesh.vertices_m.astype(np.float32), mesh.triangles, mesh.vertex_sets["mouth"]


def test_the_cells_of_a_tube_are_its_slices_however_the_wall_has_moved():
    """Cross-sections that are pressed flat and shifted aside keep the volume that their area gives."""
    points_m, triangles, mouth = tube()
    cells = LumenCells(points_m, triangles, mouth, 1e-3)
    assert cells.n > 40
    area_m2 = 0.5 * AROUND * RADIUS_M**2 * np.sin(2.0 * np.pi / AROUND)
    for flat, shift_m in ((1.0, 0.0), (0.6, 3e-3)):
        moved_m = points_m.astype(float)
        moved_m[:, 1] = flat * moved_m[:, 1] + shift_m * np.sin(100.0 * moved_m[:, 0])
        volumes_m3 = cells.volumes_m3(cells.corners_m(moved_m))
        assert volumes_m3.min() > 0.2 * volumes_m3.mean()
        assert volumes_m3.sum() == pytest.approx(flat * area_m2 * LENGTH_M, rel=1e-4)


def test_the_cells_of_a_fork_are_its_lumen():
    points_m, triangles, mouth = fork()
    cells = LumenCells(points_m, triangles, mouth)
    volumes_m3 = cells.volumes_m3(cells.corners_m(points_m))
    enclosed_m3 = enclosed_volume_m3(TriangleMesh(points_m.astype(float), triangles))
    assert volumes_m3.min() > 0.0
    assert volumes_m3.sum() == pytest.approx(enclosed_m3, rel=1e-3)


def test_a_fork_has_cells_of_its_own_on_each_branch():
    points_m, triangles, mouth = fork()
    cells = LumenCells(points_m, triangles, mouth)
    assert len(cells.openings) == 3
    degree = np.bincount(np.array([(cap.inner, cap.outer) for cap in cells.borders]).ravel(), minlength=cells.n)
    ends = {int(cell) for at in cells.opening_cells for cell in at}
    assert all(degree[cell] >= 1 for cell in ends)
    assert len({tuple(at) for at in cells.opening_cells}) == 3
    assert degree.max() >= 3


def test_a_place_is_in_the_cell_that_is_there():
    points_m, triangles, mouth = tube()
    cells = LumenCells(points_m, triangles, mouth, 1e-3)
    corners_m = cells.corners_m(points_m)
    random = np.random.default_rng(4)
    x, r, angle = random.uniform(-0.01, 0.07, 200), random.uniform(0.0, 8e-3, 200), random.uniform(0.0, 7.0, 200)
    places_m = np.stack([x, r * np.cos(angle), r * np.sin(angle)], axis=1)
    lumen = FilledLumen(cells, corners_m, [], np.zeros((0, 3)), np.zeros((0, 2), np.int32))
    found = np.where(cells.contains(corners_m, places_m), lumen.cells_at(places_m), -1)
    inside = (x > 0.0) & (x < LENGTH_M) & (r < RADIUS_M * np.cos(np.pi / AROUND))
    outside = (x < 0.0) | (x > LENGTH_M) | (r > RADIUS_M)
    assert (found[inside] >= 0).all()
    assert (found[outside] == -1).all()
    ends_m = np.array([_extent_m(cells, corners_m, cell) for cell in range(cells.n)])
    low, high = ends_m[found[inside]].T
    beside_m = 1e-3  # the nearest vertex is of the next cell at most
    assert ((x[inside] > low - beside_m) & (x[inside] < high + beside_m)).all()


def _extent_m(cells, corners_m, cell):
    x = corners_m[cells.triangles[cells.wall & (cells.cell == cell)], 0]
    return x.min(), x.max()


def a_channel(n, outlets=(0,), links=None, volume_m3=1e-8, length_m=1e-3):
    links = np.array([(k, k + 1) for k in range(n - 1)] if links is None else links)
    return FlowChannel(np.full(n, volume_m3), np.full(n, 2e-5), np.full(n, length_m), links, np.array(outlets))


def test_what_was_injected_is_there_or_has_left_and_no_share_leaves_its_bounds():
    flow, channel = ContrastFlow(20), a_channel(20, outlets=(0, 19))
    for duration_s in (1e-3, 10.0, 0.05, 300.0, 0.05):
        flow.inject(steady_flow(channel, 7, 0.2e-6), duration_s)
        assert flow.share.min() >= -1e-12
        assert flow.share.max() <= 1.0 + 1e-12
        there_m3 = float(flow.share @ channel.volume_m3)
        assert there_m3 + flow.left_m3 == pytest.approx(flow.injected_m3, rel=1e-9)


def test_the_front_moves_with_the_flow_over_the_cross_section():
    """Before anything has come to the end, the agent's mean place is half of Q t / A, whatever it mixes."""
    n, rate_m3_s = 200, 0.2e-6
    flow, channel = ContrastFlow(n), a_channel(n, outlets=(n - 1,))
    area_m2 = channel.volume_m3[0] / channel.length_m[0]
    time_s = 0.25 * n * 1e-3 * area_m2 / rate_m3_s
    for _ in range(400):
        flow.inject(steady_flow(channel, 0, rate_m3_s), time_s / 400)
    reach_m = rate_m3_s * time_s / area_m2
    assert flow.share.sum() * 1e-3 == pytest.approx(reach_m, rel=1e-6)
    half = np.searchsorted(-flow.share, -0.5) * 1e-3
    assert half == pytest.approx(reach_m, rel=0.02)


@pytest.mark.parametrize("more", [1, 2, 5])
def test_two_ways_share_the_flow_by_poiseuille(more):
    """From the cell of the tip one way of 10 cells, and one as wide of `more` times as many, both open at their ends.

    To the rim each is as long as its cells and half of the first, so the flows are as 10.5 to 10 `more` + 0.5.
    """
    short, long = 10, 10 * more
    links = [(k, k + 1) for k in range(short)]
    links += [(0, short + 1), *((k, k + 1) for k in range(short + 1, short + long))]
    channel = a_channel(1 + short + long, outlets=(short, short + long), links=links)
    full, left_m3 = ContrastFlow(1 + short + long), []
    full.inject(steady_flow(channel, 0, 0.2e-6), 1e9)
    np.testing.assert_allclose(full.share, 1.0, rtol=1e-6)
    for out in (short, short + long):  # what one end loses, if agent is there alone
        flow = ContrastFlow(1 + short + long)
        flow.share[out] = 1.0
        flow.inject(steady_flow(channel, 0, 0.2e-6), 1e-6)
        left_m3.append(flow.left_m3)
    assert left_m3[0] / left_m3[1] == pytest.approx((long + 0.5) / (short + 0.5), rel=1e-3)
    assert sum(left_m3) == pytest.approx(0.2e-6 * 1e-6, rel=1e-3)


def layout(stone_radii_m=()):
    points_m, triangles, mouth = tube()
    far = tuple(range(len(points_m) - AROUND, len(points_m)))
    return PictureLayout(
        1, "", points_m, triangles, THICKNESS_M, tuple(mouth.tolist()), far, 20, 0.8e-3, (),
        stone_radii_m=stone_radii_m,
    )  # fmt: skip


def a_picture(made, tick, tip_x_m, stones_m=()):
    line_m = np.linspace((tip_x_m - 40e-3, 0.0, 0.0), (tip_x_m, 0.0, 0.0), 20).astype(np.float32)
    stones_m = np.array(stones_m, np.float32).reshape(-1, 3)
    return Picture(1, tick=tick, points_m=made.rest_m, centreline_m=line_m, stones_m=stones_m)


def weakened(view):
    """What the rays have lost, as a multiple of the agent's attenuation times the duct's inner width."""
    return view._weakened / (CONTRAST_1_M * 2.0 * INNER_M)


def filled(made, *pictures):
    view = Cholangioscope((201, 81))
    for picture in pictures:
        view.update(made, picture)
    return view


def test_a_full_duct_weakens_by_its_inner_width_and_a_stone_takes_its_own_out():
    """A ray through the middle meets 2 r of agent; one through a stone's middle so much less as the stone is wide."""
    stone_m, place_m = 2e-3, (45e-3, 0.0, 0.0)
    full, empty, stony = {}, {}, {}
    for made, stones, seen in ((layout(), (), full), (layout((stone_m,)), (place_m,), stony)):
        pictures = [a_picture(made, tick, 30e-3, stones) for tick in (0, 90_000)]  # six times the duct's volume
        seen["view"] = filled(made, *pictures)
        np.testing.assert_allclose(seen["view"].flow.share, 1.0, atol=0.02)
        empty["view"] = filled(made, pictures[0])
        seen["agent"] = weakened(seen["view"]) - weakened(empty["view"])
    middle = full["agent"].shape[0] // 2
    line = full["agent"][middle]
    plateau = line[(line > 0.9).nonzero()[0]]
    assert len(plateau) > 80
    np.testing.assert_allclose(np.median(plateau), 1.0, atol=0.01)
    taken = (full["agent"] - stony["agent"])[middle]
    assert taken.max() == pytest.approx(2.0 * stone_m / (2.0 * INNER_M), rel=0.03)


def test_no_agent_comes_while_the_tip_is_outside_and_it_begins_anew_with_the_recording():
    made = layout()
    view = filled(made, a_picture(made, 0, -5e-3), a_picture(made, 2000, -5e-3))
    assert view.flow.injected_m3 == 0.0
    view.update(made, a_picture(made, 3000, 20e-3))
    assert view.flow.injected_m3 == pytest.approx(RATE_M3_S * 1.0)
    view.update(made, a_picture(made, 10, 20e-3))
    assert view.flow.injected_m3 == 0.0


def test_nothing_flows_out_of_a_rim_that_is_tied():
    made = layout()
    view = Cholangioscope((81, 41), frozenset({"clamped"}))
    for tick in (0, 60_000):
        view.update(made, a_picture(made, tick, 30e-3))
    x_m = np.array(
        [np.mean(_extent_m(view._cells, view._cells.corners_m(made.rest_m), cell)) for cell in range(view._cells.n)]
    )
    assert view.flow.share[x_m < 28e-3].min() > 0.98
    assert view.flow.share[x_m > 34e-3].max() < 1e-6
