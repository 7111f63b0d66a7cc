"""What catheter and duct store: of books of energy, and of whoever takes up another state of them."""

from __future__ import annotations

import numpy as np

from services.mechanics.rod.energy import RodEnergy, rod_energy
from services.mechanics.rod.model import RodWork
from services.mechanics.rod.twist import add_frame_forces
from services.mechanics.world import World


def body_energies_j(world: World, rod: RodEnergy | None = None) -> dict[str, float]:
    """Return what bodies store at the end of the last step, in J; not for the 1 kHz step.

    ``rod`` is the catheter's, where it is known already.
    """
    duct = world.duct
    return {
        "catheter": (rod or catheter_energy(world)).total_j,
        "duct": duct.kinetic_energy_j() + duct.strain_energy_j(),
        "duct_load": -float(np.sum(duct.constant_modal_force * duct.state.q)),
    }


def catheter_energy(world: World, work: RodWork | None = None) -> RodEnergy:
    """Return the catheter's energies with the material frame brought to where the particles are: in a step it lags."""
    integrator, state = world.catheter.integrator, world.catheter.state
    if integrator.twist is not None:
        state = state.copy()
        add_frame_forces(integrator.twist, state, np.zeros_like(state.position_m))
    return rod_energy(integrator.model, state, integrator.twist, work)
