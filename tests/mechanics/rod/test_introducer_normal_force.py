"""How hard the introducer's wall pushes on a rod: it follows from what is outside, not from where particles lie."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from trocar.services.mechanics.rod import ImplicitIntegrator, Introducer, Supports, straight_rod
from trocar.services.mechanics.rod.introducer_normal_force import introducer_normal_force
from trocar.services.mechanics.rod.introducer_passage import find_passage
from trocar.studies.published.rods import DAMPED, X, example_rod, step_to_rest

EXIT_M, BEARING_M, FREE_M, LOAD_N = 0.04, 8e-3, 0.03, 1e-3
SHIFTS = (0.0, 0.2, 0.4, 0.6, 0.8)


def pushes(n_segments, shifts=SHIFTS, **load_n):
    """Of a rod that a load on its tip bends, with the tip ``FREE_M`` outside and up to a segment less."""
    properties = example_rod(n_segments, **DAMPED)
    introducer = Introducer((0.0, 0.0, 0.0), (EXIT_M, 0.0, 0.0), bearing_length_m=BEARING_M)
    found = []
    for shift in shifts:
        integrator = ImplicitIntegrator(properties, Supports(held=(0,), introducer=introducer))
        start_m = EXIT_M + FREE_M - properties.length_m - shift * properties.segment_length_m
        state = straight_rod(properties, (start_m, 0.0, 0.0), X)
        load = np.zeros((n_segments + 1, 3))
        load[-1, 2] = -LOAD_N
        step_to_rest(integrator, state, load, speed_m_s=1e-6)
        model, x = integrator.model, state.position_m
        found.append(introducer_normal_force(model, x, find_passage(model.introducer, x)) / expected(x[-1, 0] - EXIT_M))
    return np.array(found)


def expected(lever_m):
    """Of a wall that holds the load and its moment at the exit, both spread over the bearing length."""
    span = BEARING_M / 3.0
    bell = BSpline.basis_element(span * np.array([-1.5, -0.5, 0.5, 1.5]), extrapolate=False)
    s = np.linspace(-1.5 * span, 1.5 * span, 20_001)[1:-1]
    density = 3.0 / BEARING_M * bell(s) * LOAD_N
    couple = 3.0 / BEARING_M * bell.derivative()(s) * LOAD_N * lever_m
    return float(np.sum(np.abs(density - couple)) * (s[1] - s[0]))


def test_what_the_wall_pushes_with_is_the_load_and_its_couple_wherever_particles_lie():
    # Segments of 2.5 mm: the clamp that they make gives by a part of one, of 30 mm that are outside.
    assert pushes(40) == pytest.approx(1.0, abs=0.06)


def test_it_converges_with_the_distance_of_particles():
    coarse, middle, fine = (np.abs(pushes(n) - 1.0).max() for n in (20, 40, 80))
    assert middle < 0.5 * coarse
    assert fine < 0.6 * middle


@pytest.mark.parametrize("at_m", np.linspace(10e-3, 20e-3, 7))
def test_a_single_push_counts_whole_wherever_it_is(at_m):
    """One particle that stands off the axis; the push of what stands off one way is the plain sum of pushes."""
    properties = example_rod(40)
    introducer = Introducer((0.0, 0.0, 0.0), (EXIT_M, 0.0, 0.0), bearing_length_m=BEARING_M)
    model = ImplicitIntegrator(properties, Supports(introducer=introducer)).model
    x = straight_rod(properties, (at_m - 16 * properties.segment_length_m, 0.0, 0.0), X).position_m
    x[16, 2] = 1e-5
    push_n = introducer.lateral_stiffness_n_m * 1e-5
    assert introducer_normal_force(model, x, find_passage(model.introducer, x)) == pytest.approx(push_n, rel=1e-12)


def test_an_introducer_needs_a_length_over_which_it_bears():
    with pytest.raises(ValueError, match="bearing_length_m"):
        Introducer((0.0, 0.0, 0.0), (EXIT_M, 0.0, 0.0), bearing_length_m=0.0).springs()
