"""Let practised hands insert the catheter, and watch its depth: ``python -m trocar.examples.insert_and_watch``."""

# %% The scene of configs/scenes/insertion.yaml, and what its hands do
import numpy as np

import trocar

simulation, hands = trocar.simulate(trocar.load_scene("insertion")), trocar.Hands()
motion = trocar.expert(simulation)

# %% Ticks of 1 ms; every tenth of a second a line
for tick in range(round(1000 * motion.duration_s) + 1):
    motion.write_inputs(1e-3 * tick, hands)
    simulation.step(hands)
    if tick % 100 == 0:
        depth_mm, pull_n = 1e3 * simulation.inserted_length_m, np.linalg.norm(simulation.tool_results.force_n[0])
        print(f"{1e-3 * tick:4.1f} s  {depth_mm:5.1f} mm in  {pull_n:5.2f} N  {'#' * round(2 * depth_mm)}")

# %% How far the wall has moved where it moved most
moved_m = trocar.wall_m(simulation) - simulation.duct.reduced.mesh.vertices_m
print(f"the wall has moved by {1e3 * np.linalg.norm(moved_m, axis=1).max():.2f} mm at most")
