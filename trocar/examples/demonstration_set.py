"""Record 50 of an expert's insertions as a LeRobot dataset: ``python -m trocar.examples.demonstration_set FOLDER [N]``.

Needs ``trocar[envs,parquet]``. FOLDER gets the recordings and the dataset; beside them it clones from both.
"""

# %% N insertions, whose hands tremble and whose catheters begin at different places
import sys
from pathlib import Path

import numpy as np

from trocar.envs.cloning import clone, read_demonstrations
from trocar.envs.demonstration_set import EPISODES, make_set
from trocar.envs.lerobot import read_dataset

folder, n = Path(sys.argv[1]), int((*sys.argv[2:], EPISODES)[0])
wall = ("duct.n_around=20", "duct.n_along=26", "duct.n_modes=40")
made = make_set(folder, n, overrides=wall, on_outcome=lambda each: print(f"seed {each.seed}: {each.steps} steps"))
print(f"{made.said}; {made.successes} succeeded")

# %% A policy that is cloned from the dataset is that of the recordings
from_dataset, from_recordings = clone(*read_dataset(made.dataset)), clone(*read_demonstrations(made.recordings))
same = np.array_equal(from_dataset.weights, from_recordings.weights)
print(f"policies cloned from dataset and recordings are {'the same to the bit' if same else 'different'}")
