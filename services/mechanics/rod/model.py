"""A rod's properties and supports as the plain arrays that the kernels read, and the arrays that they write."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import BoolArray, FloatArray, IntArray

from .banded import HALF_BANDWIDTH, empty_band
from .properties import RodProperties
from .supports import Supports


class RodModel(NamedTuple):
    """Read-only arrays of one rod: n particles, n - 1 segments, n - 2 joints.

    mass, drag (n,) [kg, N s/m]; EA (n-1,) [N]; joint_stiffness (n-2,) [N m/rad]; rest_length [m]; beta [s];
    walls (2, 3) with NaN rows where an end may turn; wall_stiffness (2,) [N m/rad]; introducer (13,) or (0,);
    held (h,) particle indices; is_held (n,).
    """

    mass: FloatArray
    drag: FloatArray
    EA: FloatArray
    joint_stiffness: FloatArray
    rest_length: float
    beta: float
    walls: FloatArray
    wall_stiffness: FloatArray
    introducer: FloatArray
    held: IntArray
    is_held: BoolArray


class RodWork(NamedTuple):
    """What a step fills: the configuration that forces are taken at, the forces, and the banded system.

    settled, settled_velocity (n, 3), how the last step ended; position, velocity, force (n, 3); tangent (n-1, 3);
    length (n-1,); gradient (2, 9) of one joint; band, rhs, its copy residual, and velocity_change (n, 3) of the
    implicit step.
    """

    settled: FloatArray
    settled_velocity: FloatArray
    position: FloatArray
    velocity: FloatArray
    force: FloatArray
    tangent: FloatArray
    length: FloatArray
    gradient: FloatArray
    band: FloatArray
    rhs: FloatArray
    residual: FloatArray
    velocity_change: FloatArray


def build_model(properties: RodProperties, supports: Supports) -> RodModel:
    """Lay the numbers out; raises ValueError where the supports do not fit the rod."""
    EI = properties.per_segment("bending_stiffness_n_m2")
    held = supports.held_indices(properties.n_particles)
    is_held = np.zeros(properties.n_particles, dtype=np.bool_)
    is_held[held] = True
    return RodModel(
        mass=properties.particle_mass_kg(),
        drag=properties.particle_drag_n_s_m(),
        EA=properties.per_segment("axial_stiffness_n"),
        joint_stiffness=properties.joint_stiffness_n_m(),
        rest_length=properties.segment_length_m,
        beta=float(properties.internal_damping_s),
        walls=supports.wall_directions(),
        wall_stiffness=2.0 * EI[[0, -1]] / properties.segment_length_m,
        introducer=supports.introducer.as_array() if supports.introducer is not None else np.zeros(0),
        held=held,
        is_held=is_held,
    )


def allocate_work(n_particles: int) -> RodWork:
    """Zeroed arrays for one rod; nothing else is allocated while stepping."""
    n = n_particles
    return RodWork(
        settled=np.zeros((n, 3)),
        settled_velocity=np.zeros((n, 3)),
        position=np.zeros((n, 3)),
        velocity=np.zeros((n, 3)),
        force=np.zeros((n, 3)),
        tangent=np.tile([1.0, 0.0, 0.0], (n - 1, 1)),
        length=np.zeros(n - 1),
        gradient=np.zeros((2, 9)),
        band=empty_band(3 * n),
        rhs=np.zeros(3 * n + HALF_BANDWIDTH),
        residual=np.zeros(3 * n + HALF_BANDWIDTH),
        velocity_change=np.zeros((n, 3)),
    )
