"""The same rod seen from elsewhere, or numbered from its other end, moves the same."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trocar.services.mechanics.rod import Supports, build_integrator, initial_frame, straight_rod
from trocar.studies.published.rods import example_rod

STEPS = 100


def move(integrator_name, rotation, shift, *, twist=False):
    extra = {}
    if twist:
        curvature = np.tile([20.0, 5.0, 30.0], (49, 1))
        extra = {"torsional_stiffness_n_m2": 17e-6, "rest_curvature_1_m": curvature}
    properties = example_rod(axial_stiffness_n=5.0, viscous_drag_n_s_m2=0.02, **extra)
    start = rotation.apply([1.0, 0.2, 0.0])
    supports = Supports(held=(0,), start_direction=start)
    integrator = build_integrator(integrator_name, properties, supports)
    state = straight_rod(properties, shift, start)
    if twist:
        director = rotation.apply([0.0, 0.0, 1.0])
        state.frame = initial_frame(state.position_m, tuple(director), supports.wall_directions())
    rng = np.random.default_rng(7)
    load = rotation.apply(rng.normal(size=(51, 3)) * 1e-3)
    for _ in range(STEPS):
        integrator.predict(state, load, 1e-3)
    return rotation.inv().apply(state.position_m - shift)


@pytest.mark.parametrize("integrator", ["implicit", "semi_implicit"])
@pytest.mark.parametrize("twist", [False, True])
def test_rotating_and_moving_everything_changes_nothing_else(integrator, twist):
    here = move(integrator, Rotation.identity(), np.zeros(3), twist=twist)
    there = move(integrator, Rotation.from_rotvec([0.5, -1.2, 2.0]), np.array([0.3, -0.2, 0.1]), twist=twist)
    assert np.linalg.norm(here[-1] - here[0]) > 0.05
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-8)


@pytest.mark.parametrize("integrator", ["implicit", "semi_implicit"])
def test_numbering_the_particles_from_the_other_end_changes_nothing(integrator):
    EI = np.linspace(13e-6, 33e-6, 50)
    load = np.random.default_rng(8).normal(size=(51, 3)) * 1e-3
    forward = example_rod(axial_stiffness_n=5.0, bending_stiffness_n_m2=EI)
    backward = example_rod(axial_stiffness_n=5.0, bending_stiffness_n_m2=EI[::-1].copy())
    one = build_integrator(integrator, forward, Supports(held=(0,), start_direction=(1, 0, 0)))
    other = build_integrator(integrator, backward, Supports(held=(-1,), end_direction=(-1, 0, 0)))
    a = straight_rod(forward, (0, 0, 0), (1, 0, 0))
    b = straight_rod(backward, (0.1, 0, 0), (-1, 0, 0))
    for _ in range(STEPS):
        one.predict(a, load, 1e-3)
        other.predict(b, load[::-1].copy(), 1e-3)
    assert np.abs(a.position_m[-1] - [0.1, 0.0, 0.0]).max() > 0.01
    np.testing.assert_allclose(b.position_m[::-1], a.position_m, rtol=0, atol=1e-8)
