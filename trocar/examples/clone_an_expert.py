"""Record an expert, and clone it: ``python -m trocar.examples.clone_an_expert [N]``; needs ``trocar[envs]``."""

# %% N episodes whose hands tremble, on a coarse wall; each is a recording that `trocar score` and `trocar report` read
import sys
import tempfile
from pathlib import Path

from trocar.envs.cloning import clone, read_demonstrations
from trocar.envs.rollouts import rollouts

n, folder = int((*sys.argv[1:], "4")[0]), Path(tempfile.mkdtemp())
wall = ("duct.n_around=20", "duct.n_along=26", "duct.n_modes=40")
for shown in rollouts(None, range(n), noise=0.1, record=str(folder), overrides=wall):
    print(f"expert, seed {shown.seed}: {'success' if shown.success else 'failure'}, cost {shown.cost_s:.0f} s")

# %% A policy of what was seen and done in them, and what it reaches within 8 s in an episode that it has not seen
policy = clone(*read_demonstrations(sorted(folder.glob("*.mcap"))))
for reached in rollouts(policy, [100], overrides=wall, max_episode_steps=400):
    what = "success" if reached.success else "failure"
    print(f"clone, seed {reached.seed}: {what}, cost {reached.cost_s:.0f} s, {1e3 * reached.depth_m:.1f} mm deep")
