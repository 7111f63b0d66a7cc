"""Poke the duct with the tip of a forceps and plot the force: ``python -m trocar.examples.poke [picture.svg]``."""

# %% A duct of 40 mm along x whose wall is 1 mm thick, and one forceps with shut jaws
import sys

import numpy as np

import trocar

duct = trocar.DuctScene(thickness_m=1e-3, n_around=20, n_along=20, n_modes=40)
forceps = trocar.ForcepsScene(port_position_m=(30e-3, 0.0, 150e-3))
simulation, hands = trocar.simulate(trocar.Scene(duct=duct, forceps=(forceps, forceps))), trocar.Hands()
hands.present[1] = False

# %% Come down for 150 ms, a tick of 1 ms at a time, and go back up; the force is what the hand would feel
down_m = np.linspace(22e-3, 16.5e-3, 150)
height_m = np.concatenate([down_m, down_m[::-1]])
force_n = np.empty(len(height_m))
for tick, z_m in enumerate(height_m):
    hands.position_m[0] = 30e-3, 0.0, z_m
    simulation.step(hands)
    force_n[tick] = simulation.tool_results.force_n[0, 2]
print(f"{force_n.max():.3f} N at most, {1e-3 * sum(simulation.stage_cost_ns.values()):.0f} us for the last tick")

# %% The plot, where matplotlib is there: extra `study`
try:
    from matplotlib.figure import Figure
except ModuleNotFoundError:
    print("no plot without matplotlib: pip install matplotlib")
else:
    figure = Figure(figsize=(5, 3), layout="constrained")
    axes = figure.subplots()
    axes.plot(1e3 * height_m, force_n)
    axes.set(xlabel="height of the tip, mm", ylabel="force upwards, N")
    figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "poke.svg")
