"""The classical rod problems: each function solves one by the rod's own time steps and returns its number.

All on the example rod of 100 mm and EI = 25 N mm^2 unless an argument says otherwise; static answers are what a damped
motion settles to.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.rod import (
    ImplicitIntegrator,
    RodProperties,
    RodState,
    Supports,
    clamped,
    initial_frame,
    roll,
    straight_rod,
)

LENGTH_M = 0.1
EI = 25e-6
EA = 176.7
GJ = 17e-6
LINE_DENSITY = 1.944e-3
X = (1.0, 0.0, 0.0)
BOTH_CLAMPED = Supports(held=(0, -1), start_direction=X, end_direction=X)
INEXTENSIBLE = {"axial_stiffness_n": 1e4}
DAMPED = {"internal_damping_s": 5e-3, "viscous_drag_n_s_m2": 0.05}
BETA_L = (1.87510, 4.69409, 7.85476)  # of the clamped-free beam
EULER_FACTOR = {"pinned-pinned": 1.0, "clamped-pinned": 0.699, "clamped-clamped": 0.5}


def example_rod(n_segments: int = 50, **changes: Any) -> RodProperties:
    """100 mm, radius 0.75 mm, E 100 MPa, 1100 kg/m3, undamped; `changes` replace properties by name."""
    values: dict[str, Any] = {
        "n_segments": n_segments,
        "length_m": LENGTH_M,
        "radius_m": 0.75e-3,
        "axial_stiffness_n": EA,
        "bending_stiffness_n_m2": EI,
        "linear_density_kg_m": LINE_DENSITY,
    }
    return RodProperties(**(values | changes))


def step_to_rest(
    integrator: ImplicitIntegrator, state: RodState, force_n: FloatArray, dt_s: float = 5e-3, speed_m_s: float = 1e-8
) -> RodState:
    """Step `state` in place under a dead load until nothing moves; RuntimeError if that does not happen."""
    for _ in range(20_000):
        integrator.predict(state, force_n, dt_s)
        if np.abs(state.velocity_m_s).max() < speed_m_s:
            return state
    raise RuntimeError(f"the rod still moves at {np.abs(state.velocity_m_s).max():.3g} m/s")


def elastica_tip(load: float, n_segments: int = 50) -> tuple[float, float, float]:
    """Tip angle [rad], deflection w/L and shortening u/L of a cantilever under a dead tip load, load = P L^2/EI."""
    properties = example_rod(n_segments, **INEXTENSIBLE, internal_damping_s=0.01, viscous_drag_n_s_m2=0.1)
    state = straight_rod(properties, (0, 0, 0), X)
    force = np.zeros((n_segments + 1, 3))
    force[-1, 2] = -load * EI / LENGTH_M**2
    step_to_rest(ImplicitIntegrator(properties, clamped(X)), state, force, dt_s=2e-3, speed_m_s=1e-9)
    last = state.position_m[-1] - state.position_m[-2]
    tip = state.position_m[-1] / LENGTH_M
    return float(np.arctan2(-last[2], last[0])), float(-tip[2]), float(1.0 - tip[0])


def end_moment(n_segments: int = 50) -> tuple[float, FloatArray]:
    """Distance of the tip from the clamp over L, and curvature times L/(2 pi) per joint, under M = 2 pi EI/L."""
    properties = example_rod(n_segments, **INEXTENSIBLE, **DAMPED)
    integrator = ImplicitIntegrator(properties, clamped(X))
    state = straight_rod(properties, (0, 0, 0), X)
    force = np.zeros((n_segments + 1, 3))
    for step in range(4000):
        # a couple on the last segment, which turns with it
        moment = 2.0 * np.pi * EI / LENGTH_M * min(step / 1000, 1.0)
        arm = state.position_m[-1] - state.position_m[-2]
        force[-1] = moment * np.cross([0.0, 1.0, 0.0], arm) / (arm @ arm)
        force[-2] = -force[-1]
        integrator.predict(state, force, 2e-3)
    if np.abs(state.velocity_m_s).max() > 1e-8:
        raise RuntimeError("the ring has not come to rest")
    gap = float(np.linalg.norm(state.position_m[-1] - state.position_m[0])) / LENGTH_M
    return gap, joint_curvature(state, properties) * LENGTH_M / (2.0 * np.pi)


def joint_curvature(state: RodState, properties: RodProperties) -> FloatArray:
    """(n - 2,) bending angle of each joint over the segment length [1/m]."""
    edge = np.diff(state.position_m, axis=0)
    cosine = np.sum(edge[1:] * edge[:-1], axis=1) / properties.segment_length_m**2
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)) / properties.segment_length_m)


def buckled_tip_angle(ratio: float, n_segments: int = 50) -> float:
    """Tip angle [rad] of a clamped-free column pushed along its axis by `ratio` times its Euler load."""
    properties = example_rod(n_segments, **DAMPED)
    state = straight_rod(properties, (0, 0, 0), X)
    state.position_m[:, 1] += 1e-3 * np.linspace(0.0, 1.0, n_segments + 1) ** 2
    push = np.zeros((n_segments + 1, 3))
    push[-1, 0] = -ratio * np.pi**2 * EI / (2.0 * LENGTH_M) ** 2
    step_to_rest(ImplicitIntegrator(properties, clamped(X)), state, push)
    last = state.position_m[-1] - state.position_m[-2]
    return float(np.arctan2(last[1], last[0]))


def euler_load_n(ends: str) -> float:
    """The Euler load of the example rod with its ends as in EULER_FACTOR."""
    return float(np.pi**2 * EI / (EULER_FACTOR[ends] * LENGTH_M) ** 2)


def thrust_after_buckling_n(ends: str, n_segments: int = 50) -> float:
    """Thrust of a column whose ends come together by 0.02 % more than the Euler load compresses it."""
    properties = example_rod(n_segments, **DAMPED)
    supports = Supports(
        held=(0, -1),
        start_direction=X if ends.startswith("clamped") else None,
        end_direction=X if ends.endswith("clamped") else None,
    )
    integrator = ImplicitIntegrator(properties, supports)
    state = straight_rod(properties, (0, 0, 0), X)
    state.position_m[1:-1, 2] += 1e-4 * np.sin(np.linspace(0.0, np.pi, n_segments + 1))[1:-1]
    integrator.held_target_m[1] = [LENGTH_M * (1.0 - euler_load_n(ends) / EA - 2e-4), 0.0, 0.0]
    step_to_rest(integrator, state, np.zeros((n_segments + 1, 3)))
    length = np.linalg.norm(np.diff(state.position_m, axis=0), axis=1)
    return float(EA * (1.0 - length.mean() / properties.segment_length_m))


def hanging_chain(n_segments: int = 50) -> tuple[RodState, float]:
    """A chain of 150 mm without bending stiffness over a span of 100 mm: its rest, and the tension at an end [N]."""
    properties = example_rod(
        n_segments,
        length_m=0.15,
        **INEXTENSIBLE,
        bending_stiffness_n_m2=0.0,
        internal_damping_s=1e-3,
        viscous_drag_n_s_m2=0.1,
    )
    state = straight_rod(properties, (0, 0, 0), X)
    s = np.linspace(0.0, 1.0, n_segments + 1)
    state.position_m[:] = np.stack([0.1 * s, 0 * s, -0.2 * s * (1 - s)], axis=1)
    weight = np.zeros((n_segments + 1, 3))
    weight[:, 2] = -9.81 * properties.particle_mass_kg()
    step_to_rest(ImplicitIntegrator(properties, Supports(held=(0, -1))), state, weight)
    first = float(np.linalg.norm(state.position_m[1] - state.position_m[0]))
    return state, 1e4 * (first / properties.segment_length_m - 1.0)


def mode_frequency_rad_s(mode: int) -> float:
    """Euler-Bernoulli frequency of the clamped-free example rod, mode 0 first."""
    return float(BETA_L[mode] ** 2 / LENGTH_M**2 * np.sqrt(EI / LINE_DENSITY))


def mode_shape(mode: int, n_segments: int = 50) -> FloatArray:
    """(n,) clamped-free eigenfunction at the particles, unit tip deflection."""
    end = BETA_L[mode]
    z = end * np.linspace(0.0, 1.0, n_segments + 1)
    ratio = (np.cosh(end) + np.cos(end)) / (np.sinh(end) + np.sin(end))
    shape = np.cosh(z) - np.cos(z) - ratio * (np.sinh(z) - np.sin(z))
    return np.asarray(shape / shape[-1])


def ring(properties: RodProperties, mode: int, spectral_radius: float, dt_s: float, n_steps: int) -> FloatArray:
    """(n_steps,) modal amplitude of a cantilever let go from a small deflection in one mode."""
    integrator = ImplicitIntegrator(properties, clamped(X), spectral_radius=spectral_radius)
    state = straight_rod(properties, (0, 0, 0), X)
    shape = mode_shape(mode, properties.n_segments)
    state.position_m[:, 1] += 1e-5 * shape
    weight = shape * properties.particle_mass_kg()
    amplitude = np.empty(n_steps)
    for step in range(n_steps):
        integrator.predict(state, np.zeros((properties.n_particles, 3)), dt_s)
        amplitude[step] = weight @ state.position_m[:, 1]
    return amplitude


def measured_frequency_rad_s(mode: int, n_segments: int = 50) -> float:
    """Angular frequency of a vibration in one mode, from zero crossings, by the undamped midpoint rule."""
    dt_s = 2.0 * np.pi / mode_frequency_rad_s(mode) / 400
    amplitude = ring(example_rod(n_segments), mode, 1.0, dt_s, 2400)
    k = np.flatnonzero((amplitude[:-1] < 0.0) & (amplitude[1:] >= 0.0))
    crossing = k + amplitude[k] / (amplitude[k] - amplitude[k + 1])
    return float(2.0 * np.pi * (len(crossing) - 1) / ((crossing[-1] - crossing[0]) * dt_s))


def twisted_rod(
    angle_rad: float, supports: Supports | None = None, n_segments: int = 50, **changes: Any
) -> tuple[ImplicitIntegrator, RodState]:
    """A straight rod gripped at both ends, by a wall or else in mid-segment, and rolled apart by `angle_rad`."""
    damped: dict[str, Any] = {"torsional_stiffness_n_m2": GJ, **DAMPED}
    properties = example_rod(n_segments, **(damped | changes))
    state = straight_rod(properties, (0, 0, 0), X)
    supports = supports or BOTH_CLAMPED
    state.frame = initial_frame(state.position_m, walls=supports.wall_directions())
    state.frame.end_is_held = True
    roll(state.frame, -1, angle_rad)
    return ImplicitIntegrator(properties, supports), state


def torque_n_m(angle_rad: float, n_segments: int = 50) -> float:
    """Torque in a rod that is twisted by `angle_rad` between its clamped ends and too stiff to bend."""
    integrator, state = twisted_rod(angle_rad, n_segments=n_segments, bending_stiffness_n_m2=1.0)
    integrator.predict(state, np.zeros((n_segments + 1, 3)), 1e-3)
    if integrator.twist is None or state.frame is None:
        raise RuntimeError("the rod has no material frame")
    return float(np.mean(integrator.twist.torsion * state.frame.twist_rad))


def growth_under_torque_1_s(factor: float, n_segments: int = 50) -> float:
    """Growth rate of a small bend of a rod clamped at both ends under a torque of factor EI/L, without thrust."""
    integrator, state = twisted_rod(
        factor * EI / GJ,
        BOTH_CLAMPED,
        n_segments,
        axial_stiffness_n=50.0,
        viscous_drag_n_s_m2=0.5,
    )
    state.position_m[:, 1] += 1e-6 * np.sin(np.pi * np.linspace(0.0, 1.0, n_segments + 1)) ** 2
    bend = []
    for _ in range(2):  # the first second leaves the fastest growing shape alone
        for _ in range(1000):
            integrator.predict(state, np.zeros((n_segments + 1, 3)), 1e-3)
        bend.append(float(np.linalg.norm(state.position_m[:, 1:])))
    return float(np.log(bend[1] / bend[0]))


def critical_torque_factor(n_segments: int = 50) -> float:
    """M L/EI at which a small bend neither grows nor decays, by secant between two torques."""
    low, high = 8.9868 * 0.98, 8.9868 * 1.02
    slow, fast = growth_under_torque_1_s(low, n_segments), growth_under_torque_1_s(high, n_segments)
    return low - slow * (high - low) / (fast - slow)
