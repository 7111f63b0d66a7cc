"""Run with LeRobot's own Python: opens the dataset in a folder, and prints what it finds as JSON."""

import json
import sys

import numpy as np
from lerobot.datasets.compute_stats import compute_episode_stats
from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset("trocar/set", root=sys.argv[1], video_backend="pyav")
moment = dataset[10]
image = moment.get("observation.images.scope")
actions = np.array([np.asarray(row) for row in dataset.hf_dataset["action"]], np.float32)
stats = compute_episode_stats({"action": actions}, {"action": {"dtype": "float32"}})["action"]
ours = dataset.meta.stats["action"]
worst = max(float(np.abs(np.asarray(ours[name]) - stats[name]).max()) for name in ("min", "max", "mean", "std"))
print(
    json.dumps(
        {
            "length": len(dataset),
            "episodes": dataset.num_episodes,
            "fps": dataset.fps,
            "action": moment["action"].tolist(),
            "image": None if image is None else list(image.shape),
            "worst_statistic": worst,
        }
    )
)
