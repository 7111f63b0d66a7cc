"""A rod's own forces at one state, as the integrators compute them within a step."""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.rod.forces import add_internal_forces
from trocar.services.mechanics.rod.model import RodModel, RodWork, allocate_work, model_at, work_at
from trocar.services.mechanics.rod.state import RodState


def internal_forces(model: RodModel, state: RodState, work: RodWork | None = None) -> FloatArray:
    """Return the rod's own forces (n, 3) in N: elastic, damping, of clamps and introducer; not drag, not the frame's.

    With a state at rest they are the elastic ones. Allocates, so not for the 1 kHz step.

    Args:
        model, state: The rod, and where its particles are.
        work: Scratch to use again, for calls in every tick.
    """
    work = work or allocate_work(len(state.position_m))
    work.force[:] = 0.0
    work.position[:] = state.position_m
    work.lead[0] = model.beta * state.velocity_m_s
    kept = model.growth.copy()
    if not state.velocity_m_s.any():
        model.growth[:] = 0.0
    _add_forces(model.address, work.address)
    model.growth[:] = kept
    return work.force.copy()


@kernel
def _add_forces(model_address: Address[RodModel], work_address: Address[RodWork]) -> None:
    add_internal_forces(model_at(model_address), work_at(work_address), (0.0, 0.0))
