"""Compilation of the kernels that no step of a warm-up reaches, but that a loop may need later."""

from __future__ import annotations

from services.mechanics.rod.free_step import continue_sleep
from services.mechanics.simulation.simulation import Simulation


def compile_rare_kernels(simulation: Simulation) -> None:
    """Call the kernels for many contacts, a fast wall, a catheter that falls asleep, and energies.

    Physics uses them. Haptics compiles them too, in the same order, so that physics finds them in the cache.
    """
    simulation.system.strategy.compile_kernels()
    simulation.splitter.compile_kernels()
    for effect in simulation.world.effects:
        effect.potential_energy_j(simulation.world)
    catheter = simulation.catheter
    continue_sleep(catheter.step_address, catheter.state.position_m, catheter.state.velocity_m_s)
