"""Kernels that a loop may ask for late, and that no step of a warm-up reaches."""

from __future__ import annotations

from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.rod.free_step import sleep_on
from services.mechanics.simulation.simulation import Simulation


def compile_rare_kernels(simulation: Simulation, pairs: ContactPairs) -> None:
    """Call what assembles many contacts, keeps what the catheter pressed, and lets the catheter sleep.

    Physics needs them, and haptics compiles them for it: the order is the same in both.
    """
    simulation.system.strategy.compile_kernels()
    simulation.catheter_manifold.compile_kernels(simulation.system, pairs, simulation.search)
    catheter = simulation.catheter
    sleep_on(catheter.step_address, catheter.state.position_m, catheter.state.velocity_m_s)
