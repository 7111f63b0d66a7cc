"""The law of two layers of wall between jaws: against its own energy, and against an elastic foundation."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from trocar.services.mechanics.bodies.forceps.kinematics import N_CELLS
from trocar.services.mechanics.bodies.forceps.solid_wall import (
    SolidWall,
    cell_m,
    equilibrium_opening,
    jaw_gap_m,
    stored_energy_j,
    wall_reaction,
    write_indentation,
)

TOOL = 1
MODULUS, LAYERS, RADIUS, LENGTH = 3e5, 2e-3, 1e-3, 15e-3


@pytest.fixture(params=[3, 8, 21])
def wall(request):
    """Cells beyond the middle of the jaw, with the share of wall that they have in them drawn."""
    rng = np.random.default_rng(request.param)
    wall = SolidWall.zeros(thickness_m=LAYERS, modulus_pa=MODULUS)
    wall.length_m[:], wall.radius_m[:] = LENGTH, RADIUS
    wall.occupied[TOOL, 10:] = rng.uniform(0.1, 1.0, N_CELLS - 10)
    wall.free_m[TOOL] = rng.uniform(0.6, 1.0, N_CELLS) * LAYERS
    wall.layers[TOOL] = 2.0
    return wall


def openings(wall, n=40):
    """From where the first cell has no room left to where nothing is squeezed."""
    solid = 2.0 * math.asin(RADIUS / cell_m(wall, TOOL, 10))
    return np.linspace(solid + 2e-3, solid + 0.3, n)


def test_torque_is_the_slope_of_the_energy_and_falls_as_said(wall):
    for opening in openings(wall):
        d = 1e-6
        torque, fall, _ = wall_reaction(wall, TOOL, opening)
        slope = (stored_energy_j(wall, TOOL, opening - d) - stored_energy_j(wall, TOOL, opening + d)) / (2.0 * d)
        assert torque == pytest.approx(slope, rel=1e-4, abs=1e-9)
        torques = [wall_reaction(wall, TOOL, opening + sign * d)[0] for sign in (-1.0, 1.0)]
        assert fall == pytest.approx((torques[0] - torques[1]) / (2.0 * d), rel=1e-3, abs=1e-6)


def test_the_torque_is_convex_so_that_its_chords_and_tangents_are_on_the_passive_side(wall):
    torques = np.array([wall_reaction(wall, TOOL, opening)[0] for opening in openings(wall, 400)])
    assert np.all(np.diff(torques) <= 0.0)
    assert np.all(np.diff(torques, 2) >= -1e-9 * torques.max())


def test_a_little_squeeze_is_that_of_an_elastic_foundation_between_two_bars(wall):
    """Integrated over the width in which the bars are nearer than the wall is thick."""
    wall.occupied[TOOL] = 0.0
    cell = 15
    wall.occupied[TOOL, cell], wall.free_m[TOOL, cell] = 1.0, LAYERS
    depth = 1e-4 * LAYERS
    opening = 2.0 * math.asin((0.5 * (LAYERS - depth) + RADIUS) / cell_m(wall, TOOL, cell))
    assert jaw_gap_m(wall, TOOL, cell, opening) == pytest.approx(LAYERS - depth, rel=1e-9)
    half = math.sqrt(RADIUS * depth)
    line, _ = quad(lambda x: MODULUS * (depth - x * x / RADIUS) / LAYERS, -half, half)
    assert wall_reaction(wall, TOOL, opening)[2] == pytest.approx(line * LENGTH / N_CELLS, rel=1e-3)


def test_nothing_is_squeezed_to_nothing(wall):
    wall.occupied[TOOL, 10:] = 1.0
    solid = openings(wall)[0] - 2e-3
    assert wall_reaction(wall, TOOL, solid - 1e-6)[0] == math.inf
    assert wall_reaction(wall, TOOL, solid + 1e-4)[0] > 10.0 * wall_reaction(wall, TOOL, solid + 5e-2)[0]


def test_a_layer_has_half_of_the_room_between_jaws_that_squeeze_it_and_its_ridge_has_no_more(wall):
    """Its middle is in the middle of its half, from the hinge to the tips; it goes from there as the jaws open."""
    wall.occupied[TOOL, 10:] = 0.8
    (indentation, slope), cells = np.zeros((2, N_CELLS)), range(N_CELLS)
    arms_m = np.array([cell_m(wall, TOOL, cell) for cell in cells])
    for opening in openings(wall):
        gap_m = np.array([jaw_gap_m(wall, TOOL, cell, opening) for cell in cells])
        write_indentation(wall, TOOL, opening, indentation, slope)
        np.testing.assert_allclose(indentation, 0.8 * 0.25 * (LAYERS - np.clip(gap_m, 0.0, LAYERS)), atol=1e-15)
        has_room = (gap_m > 0.0) & (gap_m < LAYERS)
        np.testing.assert_allclose(slope[has_room], -0.2 * (arms_m * np.cos(0.5 * opening))[has_room])
        assert not slope[~has_room].any()


@pytest.mark.parametrize("layers", [0.0, 1.0, 2.0, 3.0])
def test_the_room_between_jaws_is_shared_by_the_layers_that_lie_there(wall, layers):
    """Half a layer is thinner by t / 2 - h / 2 n, and nothing is where there is none."""
    wall.occupied[TOOL], wall.layers[TOOL] = 1.0, layers
    opening, (indentation, slope) = openings(wall)[5], np.zeros((2, N_CELLS))
    write_indentation(wall, TOOL, opening, indentation, slope)
    gap_m = np.array([max(jaw_gap_m(wall, TOOL, cell, opening), 0.0) for cell in range(N_CELLS)])
    expected_m = np.maximum(0.25 * LAYERS - gap_m / (2.0 * layers), 0.0) if layers else np.zeros(N_CELLS)
    np.testing.assert_allclose(indentation, expected_m, atol=1e-15)
    assert not slope[indentation == 0.0].any()


def test_jaws_that_squeeze_nothing_leave_a_wall_as_thick_as_it_is(wall):
    wall.occupied[TOOL] = 0.0
    indentation, slope = np.ones((2, N_CELLS))
    write_indentation(wall, TOOL, 0.2, indentation, slope)
    assert not indentation.any()
    assert not slope.any()


@pytest.mark.parametrize("compliance", [0.5, 2.5, 50.0])
def test_jaws_stop_where_coupling_and_wall_balance_and_never_before(wall, compliance):
    for free in (-0.5, 0.0, 0.2):
        opening = equilibrium_opening(wall, TOOL, free, compliance)
        after = opening + 2e-8
        assert opening - free <= compliance * wall_reaction(wall, TOOL, opening)[0] + 1e-15
        assert after - free >= compliance * wall_reaction(wall, TOOL, after)[0]


@pytest.mark.parametrize("modulus_pa", [1e-3, 1.0, 1e3, MODULUS, 1e9])
@pytest.mark.parametrize("share", [1e-15, 1e-6, 1.0])
@pytest.mark.parametrize("free_rad", [-0.1, 0.0, 0.1])
def test_there_is_room_for_the_wall_where_it_holds_the_jaws_however_little_or_soft_it_is(modulus_pa, share, free_rad):
    """A torque without bounds would make a step's chord, and by it every number of the step, none."""
    wall = SolidWall.zeros(thickness_m=LAYERS, modulus_pa=modulus_pa)
    wall.length_m[:], wall.radius_m[:] = LENGTH, RADIUS
    wall.occupied[TOOL, 10:], wall.free_m[TOOL] = share, LAYERS
    compliance = 2.5
    opening = equilibrium_opening(wall, TOOL, free_rad, compliance)
    assert math.isfinite(wall_reaction(wall, TOOL, opening)[0])
    assert opening - 2e-8 - free_rad <= compliance * wall_reaction(wall, TOOL, opening - 2e-8)[0]
    assert (
        opening + 2e-8 - free_rad >= compliance * wall_reaction(wall, TOOL, opening + 2e-8)[0]
        or opening > math.pi - 1e-7
    )


def test_a_wall_near_the_hinge_of_jaws_that_open_wide_has_room_too():
    """It keeps them open by more than a radian."""
    wall = SolidWall.zeros(thickness_m=LAYERS, modulus_pa=MODULUS)
    wall.length_m[:], wall.radius_m[:] = LENGTH, RADIUS
    wall.occupied[TOOL, 2], wall.free_m[TOOL] = 1.0, 0.6e-3
    assert math.isinf(wall_reaction(wall, TOOL, 1.0)[0])
    opening = equilibrium_opening(wall, TOOL, 0.0, 2.5)
    torque = wall_reaction(wall, TOOL, opening)[0]
    assert 1.0 < opening < 1.5
    assert opening == pytest.approx(2.5 * torque, rel=1e-4)


@pytest.mark.parametrize("compliance", [0.5, 5.0, 50.0])
def test_wall_that_is_given_up_lets_the_jaws_shut_little_by_little(wall, compliance):
    """In 50 ticks, to the last of which a law that only got weaker would hold them apart."""
    wall.occupied[TOOL] = 0.0
    wall.occupied[TOOL, 5:9] = 1.0
    openings_rad = []
    for left in np.linspace(1.0, 0.0, 51):
        wall.occupied[TOOL, 5:9] = left
        openings_rad.append(equilibrium_opening(wall, TOOL, 0.0, compliance))
    steps = -np.diff(openings_rad)
    assert openings_rad[0] > 0.2
    assert openings_rad[-1] == pytest.approx(0.0, abs=2e-8)
    assert np.all(steps >= -2e-8)
    assert steps.max() < 0.06 * openings_rad[0]
