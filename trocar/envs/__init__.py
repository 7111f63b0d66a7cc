"""Environments for machine learning with the interface of Gymnasium: a catheter into the duct, or to a branch of it.

    import gymnasium
    import trocar.envs

    env = gymnasium.make("trocar/Insertion-v0")  # or trocar/Navigation-v0

Success, errors and cost are those of the training procedure for people, and an episode can be recorded as a file of the
rig. Needs the package gymnasium, which the extra ``envs`` brings.
"""

from __future__ import annotations

from trocar.services.messages.extras import how_to_get

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"trocar.envs needs the package 'gymnasium': {how_to_get('gymnasium')}", name=error.name
    ) from None

from trocar.envs.batch import Batch
from trocar.envs.ducts import Ducts
from trocar.envs.expert import Expert
from trocar.envs.hands import HandLimits
from trocar.envs.insertion import Insertion
from trocar.envs.navigation import DriveLimits, Navigation
from trocar.envs.randomisation import Randomisation
from trocar.envs.state import View
from trocar.envs.task import Task, TaskOptions

for _name, _steps in (("Insertion", 750), ("Navigation", 1500)):
    gymnasium.register(
        f"trocar/{_name}-v0",
        entry_point=f"trocar.envs.{_name.lower()}:{_name}",
        vector_entry_point=f"trocar.envs.batch:{_name.lower()}s",
        max_episode_steps=_steps,
    )

#: Public because signatures of the others name it: to be asked of, not made.
NAMED_ONLY = frozenset({"Ducts", "View"})

__all__ = [
    "Batch",
    "DriveLimits",
    "Ducts",
    "Expert",
    "HandLimits",
    "Insertion",
    "Navigation",
    "Randomisation",
    "Task",
    "TaskOptions",
    "View",
]
