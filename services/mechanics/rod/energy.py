"""Kinetic and elastic energies of a rod."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.rod.elasticity import bending_angle, bending_energy, segment_geometry, stretch_energy
from trocar.services.mechanics.rod.introducer_forces import introducer_energy
from trocar.services.mechanics.rod.model import RodModel, RodWork, allocate_work, model_at, work_at
from trocar.services.mechanics.rod.state import RodState
from trocar.services.mechanics.rod.twist import TwistModel, twist_energy


@dataclass(frozen=True)
class RodEnergy:
    """Energies of a rod in joule.

    Attributes:
        kinetic_j, stretch_j, twist_j: float. Of the particles, the segments, and the material frame.
        bending_j: float. Of joints and clamped ends.
        support_j: float. Of the introducer's springs.
    """

    kinetic_j: float
    stretch_j: float
    bending_j: float
    twist_j: float
    support_j: float

    @property
    def total_j(self) -> float:
        """Kinetic plus stored energy."""
        return self.kinetic_j + self.elastic_j

    @property
    def elastic_j(self) -> float:
        """Energy stored in the rod and in the springs of its supports."""
        return self.stretch_j + self.bending_j + self.twist_j + self.support_j


def rod_energy(
    model: RodModel, state: RodState, twist: TwistModel | None = None, work: RodWork | None = None
) -> RodEnergy:
    """Return the energies of a state. It allocates memory, so it is not for the 1 kHz step.

    Args:
        model, twist: Those of an integrator.
        state: Positions and velocities.
        work: Scratch, for repeated calls.
    """
    work = work or allocate_work(len(state.position_m))
    np.copyto(work.position, state.position_m)
    stretch_j, bending_j, support_j = _energies(model.address, work.address)
    return RodEnergy(
        kinetic_j=0.5 * float(np.einsum("i,ij,ij", model.mass, state.velocity_m_s, state.velocity_m_s)),
        stretch_j=stretch_j,
        bending_j=bending_j + _wall_energy(model, work),
        twist_j=twist_energy(twist, state) if twist is not None else 0.0,
        support_j=support_j,
    )


@kernel
def _energies(model_address: Address[RodModel], work_address: Address[RodWork]) -> tuple[float, float, float]:
    """Return the energies stored in stretch, bending and introducer, in J."""
    model, work = model_at(model_address), work_at(work_address)
    segment_geometry(model, work)
    support_j = introducer_energy(model, work.position) if model.introducer.is_there else 0.0
    return stretch_energy(model, work), bending_energy(model, work), support_j


def _wall_energy(model: RodModel, work: RodWork) -> float:
    if np.isnan(model.walls).all():
        return 0.0
    total = 0.0
    for wall, segment, stiffness in zip(model.walls, work.tangent[[0, -1]], model.wall_stiffness, strict=True):
        if not math.isnan(wall[0]):
            theta, _ = bending_angle((wall[0], wall[1], wall[2]), (segment[0], segment[1], segment[2]))
            total += 0.5 * float(stiffness) * theta**2
    return total
