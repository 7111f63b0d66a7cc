"""What a finer wall costs and gains: ``python -m trocar.examples.accuracy_against_time``."""

# %% A poke that stays, in a duct of so many cells; the force when the wall is still, and the median time of a tick
import time

import numpy as np

import trocar


def poke(n_around: int, n_along: int) -> tuple[float, float]:
    """Return the force upwards in N, and the time of a tick in us."""
    duct = trocar.DuctScene(thickness_m=1e-3, n_around=n_around, n_along=n_along, n_modes=60)
    forceps = trocar.ForcepsScene(port_position_m=(30e-3, 0.0, 150e-3))
    simulation, hands = trocar.simulate(trocar.Scene(duct=duct, forceps=(forceps, forceps))), trocar.Hands()
    hands.present[1] = False
    ticks_us = []
    for z_m in [*np.linspace(22e-3, 16.5e-3, 150), *[16.5e-3] * 1000]:
        hands.position_m[0] = 30e-3, 0.0, z_m
        begin_s = time.perf_counter()
        simulation.step(hands)
        ticks_us.append(1e6 * (time.perf_counter() - begin_s))
    return float(simulation.tool_results.force_n[0, 2]), float(np.median(ticks_us[-200:]))


# %% The finest of them is what the others are compared with
cells = [(12, 16), (16, 20), (24, 32), (40, 52)]
results = [poke(*each) for each in cells]
finest_n = results[-1][0]
print("  cells    force   error    tick")
for (n_around, n_along), (force_n, tick_us) in zip(cells, results, strict=True):
    error_percent = 100.0 * abs(force_n / finest_n - 1.0)
    print(f"{n_around:3} x {n_along:2}  {force_n:.4f} N  {error_percent:4.1f} %  {tick_us:4.0f} us")
