"""The example rod of the rod references, and settling it to rest."""

import numpy as np

from services.mechanics.rod import ImplicitIntegrator, RodProperties, RodState

LENGTH_M = 0.1
EI = 25e-6
EA = 176.7
LINE_DENSITY = 1.944e-3


def example_rod(n_segments=50, **changes):
    """100 mm, radius 0.75 mm, E 100 MPa, 1100 kg/m3."""
    values = {
        "n_segments": n_segments, "length_m": LENGTH_M, "radius_m": 0.75e-3, "axial_stiffness_n": EA,
        "bending_stiffness_n_m2": EI, "linear_density_kg_m": LINE_DENSITY,
    }
    return RodProperties(**(values | changes))


def settle(integrator: ImplicitIntegrator, state: RodState, force_n, dt_s=2e-3, speed_m_s=1e-9, max_steps=20000):
    """Step under a dead load until nothing moves; fails if that does not happen."""
    for _ in range(max_steps):
        integrator.predict(state, force_n, dt_s)
        if np.abs(state.velocity_m_s).max() < speed_m_s:
            return state
    raise AssertionError(f"still moving at {np.abs(state.velocity_m_s).max():.3g} m/s after {max_steps} steps")
