"""Bubbles in contrast agent: number and air, flow and rise against closed forms, walls, and the picture."""

import numpy as np
import pytest

from tests.review.test_cholangiogram import INNER_M, LENGTH_M, RADIUS_M, a_picture, layout, tube, weakened
from trocar.review.export.bubbles import DENSITY_KG_M3, VISCOSITY_PA_S, Bubbles, rise_speed_m_s
from trocar.review.export.cholangiogram import RATE_M3_S, Cholangioscope
from trocar.review.export.contrast_flow import steady_flow
from trocar.review.export.filled_lumen import FilledLumen
from trocar.review.export.lumen_cells import LumenCells
from trocar.review.export.views import FilmView
from trocar.services.mechanics.effects.gravity import GravitySettings
from trocar.services.mechanics.scene.air_bubble import AirBubble
from trocar.services.mechanics.scene.scene_model import CatheterScene, SceneModel

G = 9.81
DOWN_X, DOWN_Z = (-G, 0.0, 0.0), (0.0, 0.0, -G)


def lumen(narrows=0.0, tip_m=None, tied=()):
    """The inside of the tube, whose radius falls by a share of itself along x, empty but for a tip."""
    points_m, triangles, mouth = tube()
    points_m[:, 1:] *= 1.0 - narrows * points_m[:, :1] / LENGTH_M
    cells = LumenCells(points_m, triangles, mouth, 1e-3)
    tip_m = np.zeros((0, 3)) if tip_m is None else np.array([tip_m])
    corners_m, outlets = cells.corners_m(points_m), []
    for k, (rim, at) in enumerate(zip(cells.openings, cells.opening_cells, strict=True)):
        if ("mouth" if corners_m[rim, 0].mean() < 0.5 * LENGTH_M else "far") not in tied:
            outlets += [(k, cell) for cell in at]
    return FilledLumen(cells, corners_m, [], tip_m, np.array(outlets, np.int32).reshape(-1, 2))


def still(inside):
    return steady_flow(inside.channel, 0, 0.0)


def one(radius_m, place_m, gravity_m_s2):
    bubbles = Bubbles([AirBubble(radius_m=radius_m)], gravity_m_s2)
    bubbles.come_out(0.0, np.array(place_m))
    return bubbles


def moved_m(bubbles, inside, flow, time_s, steps=20):
    """The way of the only bubble."""
    before_m = bubbles.places_m[0].copy()
    for _ in range(steps):
        bubbles.move(inside, flow, time_s / steps)
    return bubbles.places_m[0] - before_m


def test_a_bubble_moves_as_the_flow_over_the_cross_section():
    inside = lumen(tip_m=(10e-3, 0.0, 0.0), tied=("mouth",))
    area_m2 = inside.channel.volume_m3.sum() / LENGTH_M
    assert area_m2 == pytest.approx(np.pi * RADIUS_M**2, rel=5e-3)
    flow = steady_flow(inside.channel, inside.tip, 1e-6)
    bubbles = one(0.5e-3, (20e-3, 1e-3, 0.0), (0.0, 0.0, 0.0))
    way_m = moved_m(bubbles, inside, flow, 2.0)
    np.testing.assert_allclose(way_m, (1e-6 / area_m2 * 2.0, 0.0, 0.0), rtol=5e-3, atol=2e-5)


def test_in_the_cell_of_the_tip_what_flows_begins_at_the_tip():
    """Behind it the fluid rests: the mean over the cell is the flow times the way that is left, by the volume."""
    for x_m in (20.2e-3, 20.6e-3):
        inside = lumen(tip_m=(x_m, 0.0, 0.0), tied=("mouth",))
        ends_m = [x for x in inside.cells.border_middles_m(inside.corners_m)[:, 0] if x > x_m]
        velocity_m_s = inside.velocities_m_s(steady_flow(inside.channel, inside.tip, 1e-6))[inside.tip]
        wanted_m_s = 1e-6 * (min(ends_m) - x_m) / inside.channel.volume_m3[inside.tip]
        np.testing.assert_allclose(velocity_m_s, (wanted_m_s, 0.0, 0.0), atol=2e-2 * wanted_m_s)


@pytest.mark.parametrize(("radius_m", "time_s"), [(0.1e-3, 0.5), (0.5e-3, 0.1), (2e-3, 0.1), (3.5e-3, 0.08)])
def test_it_rises_in_a_still_tube_as_the_formula_says(radius_m, time_s):
    inside = lumen()
    bubbles = one(radius_m, (20e-3, 0.0, 0.0), DOWN_X)
    way_m = moved_m(bubbles, inside, still(inside), time_s)
    speed_m_s = rise_speed_m_s(radius_m, RADIUS_M * np.cos(np.pi / 48), G)  # 2 V / S of a prism is its apothem
    assert way_m[0] == pytest.approx(speed_m_s * time_s, rel=0.01)
    np.testing.assert_allclose(way_m[1:], 0.0, atol=1e-5)


@pytest.mark.parametrize("radius_m", [5e-6, 0.1e-3, 0.5e-3, 2e-3])
def test_far_from_walls_its_weight_is_the_drag_of_a_rigid_ball(radius_m):
    speed_m_s = rise_speed_m_s(radius_m, 1e9, G)
    reynolds = 2.0 * radius_m * DENSITY_KG_M3 * speed_m_s / VISCOSITY_PA_S
    factor = 24.0 / reynolds * (1.0 + 0.15 * reynolds**0.687)
    drag_n = 0.5 * factor * DENSITY_KG_M3 * np.pi * radius_m**2 * speed_m_s**2
    assert drag_n == pytest.approx(4.0 / 3.0 * np.pi * radius_m**3 * DENSITY_KG_M3 * G, rel=1e-6)
    if reynolds < 1e-3:
        stokes_m_s = 2.0 / 9.0 * DENSITY_KG_M3 * G * radius_m**2 / VISCOSITY_PA_S
        assert speed_m_s == pytest.approx(stokes_m_s, rel=2e-3)


@pytest.mark.parametrize("ratio", [0.1, 0.3, 0.5])
def test_a_slow_bubble_in_a_tube_is_held_back_as_haberman_and_sayre_have_it(ratio):
    """Their series for creeping flow, DTMB report 1143 (1958), is another computation than that of Di Felice."""
    x, radius_m = ratio, 5e-6
    exact = (1 - 2.105 * x + 2.0865 * x**3 - 1.7068 * x**5 + 0.72603 * x**6) / (1 - 0.75857 * x**5)
    held_back = rise_speed_m_s(radius_m, radius_m / x, G) / rise_speed_m_s(radius_m, 1e3, G)
    assert held_back == pytest.approx(exact, abs=0.03)


def test_one_that_fills_the_lumen_does_not_rise():
    assert rise_speed_m_s(2e-3, 2e-3, G) == 0.0
    assert rise_speed_m_s(1.9999e-3, 2e-3, G) < 1e-2 * rise_speed_m_s(1.0e-3, 2e-3, G)


@pytest.mark.parametrize("rises", [True, False])
@pytest.mark.parametrize(("narrows", "radius_m"), [(0.6, 3.5e-3), (0.15, 4.5e-3)])
def test_it_stops_where_the_lumen_is_as_narrow_as_it_is(narrows, radius_m, rises):
    """In a cone, risen or carried, where its distance from the wall is its radius: R(x) cos of the half angle."""
    inside = lumen(narrows, (1e-3, 0.0, 0.0), tied=("mouth",))
    bubbles = one(radius_m, (5e-3, 0.0, 0.0), DOWN_X if rises else (0.0, 0.0, 0.0))
    flow = still(inside) if rises else steady_flow(inside.channel, inside.tip, 1e-6)
    moved_m(bubbles, inside, flow, 60.0)
    slope = narrows * RADIUS_M / LENGTH_M
    beside_m = (RADIUS_M - slope * bubbles.places_m[0, 0]) * np.cos(np.arctan(slope)) * np.cos(np.pi / 48) - radius_m
    assert -5e-6 < beside_m < 5e-5  # of a cell of 1.5 mm the rise knows one radius, which is 0.02 mm less in the next
    assert np.linalg.norm(moved_m(bubbles, inside, flow, 5.0)) < 2e-5


def test_it_glides_along_the_top_of_a_lying_duct():
    radius_m = 1e-3
    inside = lumen(tip_m=(10e-3, 0.0, 0.0), tied=("mouth",))
    flow = steady_flow(inside.channel, inside.tip, 1e-6)
    bubbles = one(radius_m, (20e-3, 0.0, 0.0), DOWN_Z)
    moved_m(bubbles, inside, flow, 0.2)
    top_m = bubbles.places_m[0, 2]
    assert RADIUS_M * np.cos(np.pi / 48) - 1e-5 < top_m + radius_m < RADIUS_M + 1e-5
    way_m = moved_m(bubbles, inside, flow, 1.0)
    area_m2 = inside.channel.volume_m3.sum() / LENGTH_M
    assert way_m[0] == pytest.approx(1e-6 / area_m2, rel=0.02)
    assert abs(way_m[2]) < 2e-5


RADII_M = (0.4e-3, 1.0e-3, 1.6e-3)
COME_AFTER_M3 = (0.3e-6, 0.0, 0.3e-6)


def air_m3(bubbles):
    return sum(4.0 / 3.0 * np.pi * bubble.radius_m**3 for bubble in bubbles)


def test_bubbles_and_their_air_wait_are_inside_or_have_left_until_all_are_flushed_out():
    of_catheter = [AirBubble(radius_m=r, after_m3=v) for r, v in zip(RADII_M, COME_AFTER_M3, strict=True)]
    view, made, seen = Cholangioscope((81, 41), bubbles=of_catheter, gravity_m_s2=DOWN_Z), layout(), set()
    for tick in range(0, 60_000, 1500):
        view.update(made, a_picture(made, tick, 20e-3))
        bubbles = view.bubbles
        whole = [*bubbles.waiting, *bubbles.inside, *bubbles.left]
        assert sorted(each.radius_m for each in whole) == sorted(RADII_M)
        assert air_m3(whole) == pytest.approx(air_m3(of_catheter), rel=1e-12)
        assert all(each.after_m3 > view.flow.injected_m3 for each in bubbles.waiting) or not tick
        assert len(bubbles.places_m) == len(bubbles.inside)
        away_m = np.linalg.norm(bubbles.places_m[:, 1:], axis=1) + [each.radius_m for each in bubbles.inside]
        assert (away_m < INNER_M + 1e-5).all()
        seen.add((len(bubbles.waiting), len(bubbles.inside), len(bubbles.left)))
    assert (3, 0, 0) in seen
    assert max(inside for _, inside, _ in seen) == 3
    assert not bubbles.inside
    assert len(bubbles.left) == 3


def test_none_leaves_through_an_end_that_is_tied():
    inside = lumen(tied=("mouth", "far"))
    bubbles = one(1e-3, (50e-3, 0.0, 0.0), DOWN_X)
    moved_m(bubbles, inside, still(inside), 2.0)
    assert len(bubbles.inside) == 1
    assert LENGTH_M - 1e-3 < bubbles.places_m[0, 0] <= LENGTH_M
    open_end = lumen()
    bubbles.move(open_end, still(open_end), 1.0)
    assert not bubbles.inside
    assert len(bubbles.left) == 1


def test_the_picture_has_a_gap_as_deep_as_the_chord_of_a_ball():
    """Rays beside the middle lose less, by the root of r^2 - d^2; d is measured in the picture's own scale."""
    radius_m, made = 2e-3, layout()
    view = Cholangioscope((401, 161), bubbles=[AirBubble(radius_m=radius_m, after_m3=8e-6)])
    for tick in (0, 31_900, 32_200):
        view.update(made, a_picture(made, tick, 30e-3))
    np.testing.assert_allclose(view.flow.share, 1.0, atol=0.02)
    assert len(view.bubbles.inside) == 1
    gap = weakened(view)
    bubble_m = view.bubbles.places_m.copy()
    view.bubbles.inside, view.bubbles.places_m = [], np.zeros((0, 3))
    view.update(made, a_picture(made, 32_200, 30e-3))
    gap = weakened(view) - gap
    right, down, ahead = view._lens.seen_m(bubble_m)[0]
    focal, (height, width) = view._lens.focal, gap.shape
    j, i = np.indices(gap.shape)
    x_m = ((i + 0.5 - 0.5 * width) / focal) * ahead - right
    y_m = ((j + 0.5 - 0.5 * height) / focal) * ahead - down
    chord_m = 2.0 * np.sqrt(np.maximum(radius_m**2 - x_m**2 - y_m**2, 0.0))
    deep = chord_m > radius_m
    assert deep.sum() > 100
    np.testing.assert_allclose(gap[deep] * 2.0 * INNER_M, chord_m[deep], rtol=0.04)
    np.testing.assert_allclose(gap[x_m**2 + y_m**2 > (1.1 * radius_m) ** 2], 0.0, atol=1e-9)


def test_a_scene_says_which_bubbles_come_and_what_they_weigh():
    scene = SceneModel(
        catheter=CatheterScene(bubbles=(AirBubble(radius_m=1e-3),)),
        effects={"gravity": GravitySettings((0.0, 2.0, 0.0))},
    )
    made = layout()
    for each, rises in ((scene, True), (SceneModel(catheter=scene.catheter), False)):
        view = FilmView.CHOLANGIOGRAM.open_renderer((81, 41), each)
        for tick in (0, 100, 200):
            view.update(made, a_picture(made, tick, 30e-3))
        assert (view.bubbles.places_m[0, 1] < -1e-4) == rises
    assert view.flow.injected_m3 == pytest.approx(RATE_M3_S * 0.2)
