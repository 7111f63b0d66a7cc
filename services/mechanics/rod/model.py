"""Arrays of a rod for the kernels: its properties and supports, and the work space of a step."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.compiled.struct import Struct, reader
from trocar.services.mechanics.rod.banded import HALF_BANDWIDTH, empty_band
from trocar.services.mechanics.rod.properties import RodProperties
from trocar.services.mechanics.rod.supports import IntroducerSprings, Supports


class RodModel(Struct):
    """What a rod is in the middle of a step: n particles, n - 1 segments, n - 2 joints. A step leaves it as it was."""

    mass: Annotated[FloatArray, "n"]  # kg
    drag: Annotated[FloatArray, "n"]  # N s/m
    EA: Annotated[FloatArray, "n - 1"]  # N
    joint_stiffness: Annotated[FloatArray, "n - 2"]  # N m/rad
    rest_length: Annotated[FloatArray, "n - 1"]  # m
    growth: Annotated[FloatArray, "n - 1"]  # the rate at which that grows, m/s: no strain, not damped
    tip: int  # the particle at the catheter's tip; beyond it lies what is out of a guide wire
    beta: float  # Kelvin-Voigt damping of the material, s
    walls: Annotated[FloatArray, 2, 3]  # directions of clamped ends; NaN rows where an end may turn
    wall_stiffness: Annotated[FloatArray, 2]  # N m/rad
    introducer: IntroducerSprings
    held: Annotated[IntArray, "h"]  # held particles
    is_held: Annotated[BoolArray, "n"]
    has_frame: bool = False  # whether a material frame tells if a joint whose plane turns bends its material


class RodWork(Struct):
    """What a step fills: the configuration that forces are taken at, the forces, and the banded system."""

    previous_position: Annotated[FloatArray, "n", 3]  # at the end of the last step
    position: Annotated[FloatArray, "n", 3]  # at which forces are taken
    end_position: Annotated[FloatArray, "n", 3]  # of the step whose middle ``position`` is
    lead: Annotated[FloatArray, 2, "n", 3]  # displacement that damping adds to strains, m: all, and the step's alone
    force: Annotated[FloatArray, "n", 3]
    tangent: Annotated[FloatArray, "n - 1", 3]  # of the segments
    length: Annotated[FloatArray, "n - 1"]
    elongation: Annotated[FloatArray, "n - 1"]  # of the segments, m
    taut: Annotated[FloatArray, "n - 1"]  # elongation at the start of the step, m; it stiffens a segment across
    chord: Annotated[FloatArray, "n - 1"]  # length over the mean of those at both ends of the step
    joint: Annotated[FloatArray, "n - 2", 2, 9]  # gradients of bending in and out of the plane of each joint
    aside: Annotated[FloatArray, "n - 2"]  # share of a joint's stiffness out of its plane
    has_plane: Annotated[BoolArray, "n - 2"]
    gradient: Annotated[FloatArray, 2, 9]  # of a joint with a wall
    turn: Annotated[FloatArray, "turns", 9]  # gradients of the joints' twist, see `turning`; none without a frame
    turned: Annotated[FloatArray, "turns"]
    band: Annotated[FloatArray, "padded", HALF_BANDWIDTH + 1]  # the implicit step's system, see `banded`
    rhs: Annotated[FloatArray, "padded"]
    residual: Annotated[FloatArray, "padded"]  # a copy of the right-hand side
    velocity_change: Annotated[FloatArray, "n", 3]  # the implicit step's solution
    leading_velocity: Annotated[FloatArray, "n", 3]  # on which drag acts in it
    is_middle: bool = False  # whether ``position`` is in the middle of a step from ``previous_position``
    first_joint: int = 0  # row of the first joint between two segments in ``turn``, 1 behind a wall
    hits_stop: bool = False  # whether that step would end in a stop of the introducer


model_at, work_at = reader(RodModel), reader(RodWork)


def build_model(properties: RodProperties, supports: Supports) -> RodModel:
    """Return the arrays of a rod. Raises ValueError if the supports do not fit the rod."""
    EI = properties.per_end("bending_stiffness_n_m2")
    held = supports.held_indices(properties.n_particles)
    is_held = np.zeros(properties.n_particles, dtype=np.bool_)
    is_held[held] = True
    return RodModel(
        mass=properties.particle_mass_kg(),
        drag=properties.particle_drag_n_s_m(),
        EA=properties.per_segment("axial_stiffness_n"),
        joint_stiffness=properties.joint_stiffness_n_m(),
        rest_length=np.full(properties.n_segments, properties.segment_length_m),
        growth=np.zeros(properties.n_segments),
        tip=properties.n_particles - 1,
        beta=float(properties.internal_damping_s),
        walls=supports.wall_directions(),
        wall_stiffness=2.0 * EI[[0, -1], [0, 1]] / properties.segment_length_m,
        introducer=supports.introducer.springs() if supports.introducer is not None else IntroducerSprings.zeros(),
        held=held,
        is_held=is_held,
    )


def allocate_work(n_particles: int, n_turns: int = 0) -> RodWork:
    """Return zeroed arrays for one rod with ``n_turns`` twisted joints; a step allocates nothing else."""
    n, band = n_particles, empty_band(3 * n_particles)
    tangent = np.tile([1.0, 0.0, 0.0], (n - 1, 1))
    extents = {"n": n, "n - 1": n - 1, "n - 2": n - 2, "padded": len(band), "turns": n_turns}
    return RodWork.zeros(band=band, tangent=tangent, **extents)
