"""Shadows and strains of the native picture against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.visualization.test_render import a_scene
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.visualization.cast_shadow import ACROSS, SUN, Rods, hidden
from trocar.services.visualization.strain import FULL, Strain, colours_of_strain
from trocar.services.visualization.thick_wall import ThickWall

RADIUS_M = 2e-3
ALONG, BESIDE = ACROSS.T


def _share(beside_m: np.ndarray, above_m: float) -> np.ndarray:
    """Return what a long rod hides of the lamp from points so far beside its middle line and so far below it."""
    points_m = (beside_m[:, None] * BESIDE - above_m * SUN).astype(np.float32)
    ends = np.array([[-0.2 * ALONG], [0.2 * ALONG]], np.float32)
    return hidden(points_m, ends[0], ends[1], np.array([RADIUS_M], np.float32))


def test_a_shadow_is_as_wide_as_the_rod_and_paler_and_softer_the_higher_it_is() -> None:
    beside_m = np.linspace(-20e-3, 20e-3, 4001)
    touching, near, far = (_share(beside_m, above_m) for above_m in (1e-5, 10e-3, 60e-3))
    assert touching.max() == near.max() == 1.0
    assert far.max() == pytest.approx(2.0 * RADIUS_M / (0.5e-3 + 0.2 * 60e-3), rel=1e-3)
    # Half the lamp is hidden below the rod's edge, whatever the height, as long as all of it is hidden somewhere.
    for share in (touching, near):
        assert beside_m[share > 0.5].max() == pytest.approx(RADIUS_M, abs=2e-5)
    edges_m = [np.ptp(beside_m[(share > 0.0) & (share < 1.0) & (beside_m > 0.0)]) for share in (touching, near)]
    assert edges_m == pytest.approx([0.5e-3, 2.5e-3], abs=3e-5)


def test_what_is_above_a_rod_or_beyond_its_end_is_lit() -> None:
    assert _share(np.zeros(1), -5e-3)[0] == 0.0
    beyond_m = (0.21 * ALONG - 1e-3 * SUN)[None].astype(np.float32)
    ends = np.array([[-0.2 * ALONG], [0.2 * ALONG]], np.float32)
    assert hidden(beyond_m, ends[0], ends[1], np.array([RADIUS_M], np.float32))[0] == 0.0


def test_two_rods_hide_what_one_leaves() -> None:
    ends = np.array([[-0.2 * ALONG], [0.2 * ALONG]], np.float32)
    twice = np.repeat(ends, 2, axis=1)
    point_m = (-60e-3 * SUN)[None].astype(np.float32)
    one = hidden(point_m, ends[0], ends[1], np.array([RADIUS_M], np.float32))[0]
    two = hidden(point_m, twice[0], twice[1], np.array([RADIUS_M] * 2, np.float32))[0]
    assert two == pytest.approx(1.0 - (1.0 - one) ** 2)


def test_the_rods_of_a_scene_lie_in_its_bodies() -> None:
    layout, shown = a_scene()
    starts_m, ends_m, radii_m = Rods(layout).instruments(shown)
    np.testing.assert_allclose(starts_m[0], layout.tools[0].port_m, rtol=1e-6)
    np.testing.assert_allclose(
        ends_m[1:3, 2], 0.02 - 15e-3 * np.cos(0.2), atol=1e-6
    )  # jaws straight down, 0.4 rad open
    assert radii_m[-1] == np.float32(layout.catheter_radius_m)
    with_wire = Rods(replace(layout, n_wire_segments=4, wire_radius_m=0.3e-3)).instruments(shown)
    np.testing.assert_array_equal(with_wire[0], starts_m)
    np.testing.assert_allclose(with_wire[2][[-9, -5, -4, -1]], [8e-4, 8e-4, 3e-4, 3e-4])
    middles_m, _, (radius_m, *_) = Rods(layout).duct(shown)
    centre_m = layout.rest_m.mean(axis=0)
    assert np.ptp(middles_m, axis=0).argmax() == np.ptp(layout.rest_m, axis=0).argmax()
    assert radius_m == pytest.approx(np.hypot(*(layout.rest_m - centre_m).T[1:]).mean(), rel=0.02)


@pytest.mark.parametrize("stretch", [1.0, 1.1, 1.2])
def test_strain_is_that_of_a_homogeneous_stretch_in_any_place(stretch: float) -> None:
    mesh = parametric_duct(DuctGeometry(radius_m=4e-3, length_m=40e-3, n_around=16, n_along=20))
    rest_m = mesh.vertices_m.astype(np.float32)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    moved_m = (rest_m * [stretch, 1.0, 1.0] @ turn + 0.05).astype(np.float32)
    strain = Strain(rest_m, mesh.triangles).at(moved_m)
    np.testing.assert_allclose(strain, stretch - 1.0, atol=2e-4)
    wall = ThickWall(rest_m, mesh.triangles, 5e-4, fine=True)
    assert len(wall.of_nodes(strain)) == wall.n_points
    red, _, blue = colours_of_strain(strain).mean(axis=0)
    assert (red > blue) == (strain.mean() > 0.4 * FULL)
