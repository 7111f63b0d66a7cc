"""The energies of a rod, for books that must balance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from services.mechanics.arrays import FloatArray

from .elasticity import bending_angle, bending_energy, segment_geometry, stretch_energy
from .forces import add_internal_forces
from .introducer_forces import introducer_energy
from .model import RodModel, RodWork, allocate_work
from .state import RodState
from .twist import TwistModel, twist_energy


@dataclass(frozen=True)
class RodEnergy:
    """Energies in joule; `support_j` is what the introducer's springs hold, `bending_j` counts clamped ends too."""

    kinetic_j: float
    stretch_j: float
    bending_j: float
    twist_j: float
    support_j: float

    @property
    def total_j(self) -> float:
        """Kinetic plus everything stored."""
        return self.kinetic_j + self.stretch_j + self.bending_j + self.twist_j + self.support_j


def rod_energy(model: RodModel, state: RodState, twist: TwistModel | None = None) -> RodEnergy:
    """Energies of `state` (`model` and `twist` as an integrator holds them). Allocates: not for the 1 kHz step."""
    work = allocate_work(len(state.position_m))
    np.copyto(work.position, state.position_m)
    segment_geometry(work)
    return RodEnergy(
        kinetic_j=0.5 * float(model.mass @ np.sum(state.velocity_m_s**2, axis=1)),
        stretch_j=float(stretch_energy(model, work)),
        bending_j=float(bending_energy(model, work)) + _wall_energy(model, work),
        twist_j=twist_energy(twist, state) if twist is not None else 0.0,
        support_j=float(introducer_energy(model, work)) if model.introducer.size else 0.0,
    )


def internal_forces(model: RodModel, state: RodState, before: RodState | None = None) -> FloatArray:
    """The rod's own forces (n, 3): elastic, damping, of clamps and introducer, but not the drag and the frame's.

    The introducer's friction follows the wall's push and the speed at the end of the step before: `before` is that
    state, `state` itself where it is None. With a state at rest the forces are the elastic ones. Allocates: not for the
    1 kHz step.
    """
    before = before or state
    work = allocate_work(len(state.position_m))
    work.settled[:] = before.position_m
    work.settled_velocity[:] = before.velocity_m_s
    work.position[:] = state.position_m
    work.velocity[:] = state.velocity_m_s
    add_internal_forces(model, work, (0.0, 0.0), 0.0)
    return work.force


def _wall_energy(model: RodModel, work: RodWork) -> float:
    total = 0.0
    for wall, segment, stiffness in zip(model.walls, work.tangent[[0, -1]], model.wall_stiffness, strict=True):
        if not math.isnan(wall[0]):
            theta, _ = bending_angle((wall[0], wall[1], wall[2]), (segment[0], segment[1], segment[2]))
            total += 0.5 * float(stiffness) * theta**2
    return total
