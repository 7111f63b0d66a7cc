"""Record an expert, and clone it: ``python -m trocar.examples.clone_an_expert``; needs ``trocar[envs]``."""

# %% Three episodes whose hands tremble, each a recording that `trocar score` and `trocar report` read
import tempfile
from pathlib import Path

from trocar.envs.cloning import clone, read_demonstrations
from trocar.envs.rollouts import rollouts

folder = Path(tempfile.mkdtemp())
for shown in rollouts(None, range(3), noise=0.1, record=str(folder)):
    print(f"expert, seed {shown.seed}: {'success' if shown.success else 'failure'}, cost {shown.cost_s:.0f} s")

# %% A policy of what was seen and done in them, and what it reaches in an episode that it has not seen
policy = clone(*read_demonstrations(sorted(folder.glob("*.mcap"))))
for reached in rollouts(policy, [100]):
    what = "success" if reached.success else "failure"
    print(f"clone, seed {reached.seed}: {what}, cost {reached.cost_s:.0f} s, {1e3 * reached.depth_m:.1f} mm deep")
