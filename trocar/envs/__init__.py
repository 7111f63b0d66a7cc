"""Environments for machine learning with the interface of Gymnasium: a catheter into the duct, or to a branch of it.

    import gymnasium
    import trocar.envs

    env = gymnasium.make("trocar/Insertion-v0")  # or trocar/Navigation-v0

Success, errors and cost are those of the training procedure for people, and an episode can be recorded as a file of the
rig. Needs the package gymnasium: ``pip install "trocar[envs]"``.
"""

from __future__ import annotations

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "trocar.envs needs the package 'gymnasium': install trocar[envs]", name=error.name
    ) from None

from trocar.envs.expert import Expert
from trocar.envs.hands import HandLimits
from trocar.envs.insertion import Insertion
from trocar.envs.navigation import DriveLimits, Navigation
from trocar.envs.randomisation import Randomisation

gymnasium.register("trocar/Insertion-v0", entry_point="trocar.envs.insertion:Insertion", max_episode_steps=750)
gymnasium.register("trocar/Navigation-v0", entry_point="trocar.envs.navigation:Navigation", max_episode_steps=1500)

__all__ = ["DriveLimits", "Expert", "HandLimits", "Insertion", "Navigation", "Randomisation"]
