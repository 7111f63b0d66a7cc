"""A rod's properties and supports as the plain arrays that the kernels read, and the arrays that they write."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.rod.banded import HALF_BANDWIDTH, empty_band
from services.mechanics.rod.properties import RodProperties
from services.mechanics.rod.supports import Supports


class RodModel(NamedTuple):
    """Read-only arrays of one rod: n particles, n - 1 segments, n - 2 joints.

    Attributes
    ----------
    mass, drag : (n,) float64
        In kg and N s/m.
    EA : (n - 1,) float64
        In N.
    joint_stiffness : (n - 2,) float64
        In N m/rad.
    rest_length : float
        Of a segment, in m.
    beta : float
        Kelvin-Voigt damping of the material, in s.
    walls : (2, 3) float64
        Directions of clamped ends; NaN rows where an end may turn.
    wall_stiffness : (2,) float64
        In N m/rad.
    introducer : (13,) or (0,) float64
        See `supports.Introducer.as_array`.
    held : (h,) int32
        Held particles.
    is_held : (n,) bool
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

    Attributes
    ----------
    previous_position, previous_velocity : (n, 3) float64
        How the last step ended.
    position, velocity, force : (n, 3) float64
        What forces are taken at, and the forces.
    tangent, length : (n - 1, 3), (n - 1,) float64
        Of the segments.
    gradient : (2, 9) float64
        Of one joint.
    band, rhs, residual : float64
        The implicit step's system, and a copy of its right-hand side.
    velocity_change : (n, 3) float64
        The implicit step's solution.
    """

    previous_position: FloatArray
    previous_velocity: FloatArray
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
    """Lay the numbers out.

    Raises
    ------
    ValueError
        The supports do not fit the rod.
    """
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
        previous_position=np.zeros((n, 3)),
        previous_velocity=np.zeros((n, 3)),
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
