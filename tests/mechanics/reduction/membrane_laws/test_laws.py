"""Laws of the membrane: each is the gradient of its energy, and has its closed form where there is one."""

from itertools import pairwise

import numpy as np
import pytest

from trocar.services.mechanics.reduction.membrane_laws import MEMBRANE_LAWS, density_of, law_number, parameters_of
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear


def response(name, strain, **parameters):
    """Energy, stress (3,) and tangent (3, 3) over E."""
    values = np.array(parameters_of(name, parameters), np.float64)
    energy, stress, tangent = density_of(law_number(name), tuple(map(float, strain)), values)
    a, b, c, ab, ac, bc = tangent
    return energy, np.array(stress), np.array([[a, ab, ac], [ab, b, bc], [ac, bc, c]])


def random_strains(name, n, seed=0):
    """Strains up to those that the wall's samples are chosen for, and somewhat beyond."""
    law = BeyondLinear.of(name)
    strains = np.random.default_rng(seed).standard_normal((n, 3))
    strains *= (1.2 * np.sqrt(120.0 * law.unit_form) * np.linspace(0.02, 1.0, n) / np.linalg.norm(strains, axis=1))[
        :, None
    ]
    return strains[(1.0 + strains[:, 0]) * (1.0 + strains[:, 1]) - 0.25 * strains[:, 2] ** 2 > 0.2]


@pytest.mark.parametrize("name", MEMBRANE_LAWS)
def test_stress_and_tangent_are_the_differences_of_the_energy(name):
    step = 1e-5 * np.sqrt(BeyondLinear.of(name).unit_form) * 10.0
    for strain in random_strains(name, 60):
        _, stress, tangent = response(name, strain)
        for axis, way in enumerate(np.eye(3)):
            after, before = (response(name, strain + sign * step * way) for sign in (1.0, -1.0))
            scale = np.abs(stress).max() + 1e-3
            assert (after[0] - before[0]) / (2.0 * step) == pytest.approx(stress[axis], abs=1e-5 * scale)
            slope = (after[1] - before[1]) / (2.0 * step)
            assert slope == pytest.approx(tangent[axis], abs=2e-4 * np.abs(tangent).max())


@pytest.mark.parametrize("name", MEMBRANE_LAWS)
def test_a_wall_without_strain_has_neither_energy_nor_stress_and_resists(name):
    energy, stress, tangent = response(name, np.zeros(3))
    assert energy == pytest.approx(0.0, abs=1e-15)
    assert stress == pytest.approx(np.zeros(3), abs=1e-15)
    assert np.linalg.eigvalsh(tangent).min() > 0.1


@pytest.mark.parametrize("name", MEMBRANE_LAWS)
def test_no_closed_path_of_strain_yields_work(name):
    """Sixty strains in a loop, by the mean of the stresses at both ends of short ways."""
    corners = np.concatenate([np.zeros((1, 3)), random_strains(name, 12, seed=3), np.zeros((1, 3))])
    work = paid = 0.0
    for one, other in pairwise(corners):
        way = np.linspace(one, other, 400)
        stresses = np.array([response(name, at)[1] for at in way])
        steps = np.sum(0.5 * (stresses[1:] + stresses[:-1]) * np.diff(way, axis=0), axis=1)
        work, paid = work + steps.sum(), paid + np.abs(steps).sum()
    assert abs(work) < 1e-4 * paid


@pytest.mark.parametrize("name", [name for name in MEMBRANE_LAWS if name != "saint_venant"])
def test_the_energy_is_convex_so_that_a_step_has_one_end(name):
    for strain in random_strains(name, 200, seed=1):
        area = (1.0 + strain[0]) * (1.0 + strain[1]) - 0.25 * strain[2] ** 2
        if area > 0.3:
            _, _, tangent = response(name, strain)
            assert np.linalg.eigvalsh(tangent).min() > -1e-12 * np.abs(tangent).max()


@pytest.mark.parametrize("e", [0.05, 0.15, 0.3])
def test_fung_pulled_one_way(e):
    assert response("fung", (e, 0.0, 0.0), exponent=20.0)[1] == pytest.approx([e * np.exp(20.0 * e**2), 0.0, 0.0])


@pytest.mark.parametrize("stretch", [0.8, 1.1, 1.5])
def test_rubber_pulled_one_way(stretch):
    """Free on its sides it keeps its volume: both get narrower alike."""
    stress = response("neo_hookean", (stretch - 1.0, stretch**-0.5 - 1.0, 0.0))[1]
    assert stress == pytest.approx([(stretch - stretch**-2) / 3.0, 0.0, 0.0], abs=1e-14)


@pytest.mark.parametrize("stretch", [0.9, 1.1, 1.3])
def test_saint_venant_pulled_one_way(stretch):
    green = 0.5 * (stretch**2 - 1.0)
    narrow = np.sqrt(1.0 - 2.0 * 0.3 * green)
    stress = response("saint_venant", (stretch - 1.0, narrow - 1.0, 0.0), poisson_ratio=0.3)[1]
    assert stress == pytest.approx([stretch * green, 0.0, 0.0], abs=1e-14)


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2])
@pytest.mark.parametrize("e", [0.05, 0.2, -0.1])
def test_fibres_bear_what_is_stretched_along_them(angle, e):
    """Stretched alike both ways every line is stretched alike, so two families bear 2 k1 E (exp(k2 E^2) - 1) l each."""
    stretch = 1.0 + e
    with_them = response("fibres", (e, e, 0.0), fibre_share=0.8, fibre_exponent=5.0, fibre_angle_rad=angle)[1]
    green = stretch**2 - 1.0
    borne = 4.0 * 0.8 * green * np.expm1(5.0 * green**2) * stretch if e > 0.0 else 0.0
    expected = borne * np.array([np.cos(angle) ** 2, np.sin(angle) ** 2, 0.0])
    assert with_them - response("neo_hookean", (e, e, 0.0))[1] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("name", MEMBRANE_LAWS)
def test_beyond_the_linear_wall_nothing_is_left_of_a_small_strain(name):
    law = BeyondLinear.of(name)
    small = 1e-5 * np.eye(3)
    energy, stress, tangent = law.respond(small)
    assert np.abs(stress).max() < 1e-3 * 1e-5
    assert np.abs(energy).max() < 1e-3 * 1e-10
    whole = np.array([response(name, each)[2] for each in small])
    rest = response(name, np.zeros(3))[2]
    assert tangent == pytest.approx(whole - rest, abs=1e-14)


@pytest.mark.parametrize(
    ("name", "parameters", "said"),
    [
        ("rubber", {}, "unknown law of the membrane 'rubber'; known: fung, neo_hookean"),
        ("fung", {"angle": 1.0}, "the law 'fung' has no parameter angle, it has exponent"),
        ("neo_hookean", {"exponent": 1.0}, "the law 'neo_hookean' has no parameter exponent, it has none"),
        ("fibres", {"fibre_share": -1.0}, "fibre_share of the law 'fibres' must be within 0 and 100, is -1"),
    ],
)
def test_laws_and_parameters_that_are_not_there_are_refused(name, parameters, said):
    with pytest.raises(ValueError, match=said):
        BeyondLinear.of(name, **parameters)
