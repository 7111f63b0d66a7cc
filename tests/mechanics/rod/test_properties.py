import math

import numpy as np
import pytest

from trocar.services.mechanics.rod import (
    Introducer,
    RodProperties,
    RoundTube,
    Supports,
    build_integrator,
    rod_along,
    straight_rod,
)
from trocar.studies.published.rods import example_rod


@pytest.mark.parametrize(("outer_mm", "inner_mm", "EI_n_mm2"), [(1.33, 0.8, 13.0), (1.67, 1.0, 33.0)])
def test_cholangiogram_catheters_have_the_tabulated_bending_stiffness(outer_mm, inner_mm, EI_n_mm2):
    tube = RoundTube(outer_mm * 1e-3, inner_mm * 1e-3, youngs_modulus_pa=100e6, density_kg_m3=1100)
    assert tube.rod(50, 0.1).bending_stiffness_n_m2 == pytest.approx(EI_n_mm2 * 1e-6, rel=0.03)


def test_a_solid_round_rod_twists_with_half_its_bending_stiffness_over_one_plus_nu():
    rod = RoundTube(1.5e-3, 0.0, 100e6, 1100, poisson_ratio=0.45).rod(50, 0.1, twist=True)
    assert rod.torsional_stiffness_n_m2 == pytest.approx(rod.bending_stiffness_n_m2 / 1.45)


def test_lumped_masses_sum_to_the_mass_of_the_rod():
    density = np.linspace(1e-3, 3e-3, 50)
    assert example_rod(linear_density_kg_m=density).particle_mass_kg().sum() == pytest.approx(0.1 * density.mean())


def test_a_joint_between_two_stiffnesses_is_two_half_segments_in_series():
    EI = np.full(50, 25e-6)
    EI[25:] = 5e-6
    joints = example_rod(bending_stiffness_n_m2=EI).joint_stiffness_n_m()
    half = 0.5 * 0.1 / 50
    assert joints[24] == pytest.approx(1.0 / (half / 25e-6 + half / 5e-6))
    assert joints[23] == pytest.approx(25e-6 / (2 * half))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"n_segments": 1}, "n_segments"),
        ({"length_m": 0.0}, "length_m"),
        ({"bending_stiffness_n_m2": -1.0}, "bending_stiffness_n_m2"),
        ({"axial_stiffness_n": math.nan}, "axial_stiffness_n"),
        ({"linear_density_kg_m": np.ones(3)}, "linear_density_kg_m"),
        ({"rest_curvature_1_m": np.zeros((49, 3))}, "torsional_stiffness_n_m2"),
        ({"rest_curvature_1_m": np.zeros((50, 3)), "torsional_stiffness_n_m2": 1e-5}, r"\(49, 3\)"),
        (
            {"rest_curvature_1_m": np.full((49, 3), 2e3), "torsional_stiffness_n_m2": 1e-5},
            "joint 0 to a radius of 0.354 mm, below the rod's own of 0.75 mm",
        ),
    ],
)
def test_what_has_no_physical_meaning_is_refused_by_name(changes, named):
    with pytest.raises(ValueError, match=named):
        example_rod(**changes)


@pytest.mark.parametrize(
    "supports",
    [
        Supports(held=(51,)),
        Supports(held=(0, -51)),
        Supports(start_direction=(0, 0, 0)),
        Supports(introducer=Introducer((0, 0, 0), (0, 0, 0))),
        Supports(introducer=Introducer((0, 0, 0), (1, 0, 0), friction=-1.0)),
    ],
)
def test_supports_that_do_not_fit_are_refused(supports):
    with pytest.raises(ValueError, match=r"held|direction|introducer"):
        build_integrator("implicit", example_rod(), supports)


def test_an_unknown_integrator_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="implicit, semi_implicit"):
        build_integrator("explicit", example_rod())


def test_a_rod_laid_along_a_curve_has_its_segment_length():
    angle = np.linspace(0.0, np.pi, 2000)
    circle = 0.05 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    state = rod_along(example_rod(), circle)
    length = np.linalg.norm(np.diff(state.position_m, axis=0), axis=1)
    np.testing.assert_allclose(length, 0.002, rtol=1e-4)
    with pytest.raises(ValueError, match="shorter"):
        rod_along(example_rod(), circle[:100])


def test_a_straight_rod_needs_a_direction():
    with pytest.raises(ValueError, match="direction"):
        straight_rod(example_rod(), (0, 0, 0), (0, 0, 0))


def test_properties_are_plain_data():
    assert example_rod() == RodProperties(50, 0.1, 0.75e-3, 176.7, 25e-6, 1.944e-3)
