"""The insertion of the catheter as an environment of Gymnasium."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

import numpy as np

from trocar.envs import state
from trocar.envs.episode import nearest_m
from trocar.envs.hands import COLUMNS, DeviceHands, HandLimits
from trocar.envs.task import Task, TaskOptions
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.errors import ConfigError

GRIP_BEYOND_J_M = 10e-3
"""Distance from J at which jaws grasp."""


class Insertion(Task):
    """Grasp the catheter, guide its tip into the duct and push it to the scenario's depth.

    Actions are (tools, 5) in [-1, 1]: of each instrument the velocity of J in scene axes and the rates of roll and
    handle, as fractions of `HandLimits`. An observation is the concatenation of ``state.FIELDS``, or an image. The
    rewarded path goes to the catheter, with it to the mouth, and in. Raises ConfigError: one sentence, if an argument
    is invalid.

    Args:
        scenario, observation, **options: As in `Task`.
        limits: HandLimits
    """

    def __init__(
        self,
        scenario: str | Path = "basic",
        observation: str = "state",
        *,
        limits: HandLimits | None = None,
        **options: Unpack[TaskOptions],
    ) -> None:
        super().__init__(scenario, observation, **options)
        tools = self._stage.scene.forceps
        if not tools:
            raise ConfigError(f"scenario {self.scenario.name}: its scene has no tool that an agent could move")
        if any(tool.drives_catheter for tool in tools):
            raise ConfigError(f"scenario {self.scenario.name}: a drive moves its catheter, see trocar/Navigation-v0")
        self._limits = limits or HandLimits()
        self._declare((len(tools), COLUMNS), state.MOST)

    def action_of(self, rates: FloatArray) -> FloatArray:
        """Return the rates, which are the action."""
        return rates

    def _rates_of(self, action: FloatArray) -> FloatArray:
        return action

    def _new_hands(self) -> DeviceHands:
        return DeviceHands(self._stage.scene.forceps, self._limits, self._mouth_m)

    def _new_view(self) -> state.View:
        return state.StateView(self._stage.site, self._stage.duct_file)

    def _way_m(self) -> float:
        """Return the progress along the path: negative before the mouth, then the depth."""
        return min(self.depth_m, self.scenario.goal.depth_m) - self._to_mouth_m() - self._to_catheter_m()

    def _to_catheter_m(self) -> float:
        """Return the distance of the nearest jaws from the catheter, 0 if some hold it."""
        if self._stage.grips.has_catheter:
            return 0.0
        ways = []
        for tool, forceps in enumerate(self._stage.scene.forceps):
            junction_m = self.hands.state[tool, :3]
            along = junction_m - np.array(forceps.port_position_m)
            grip_m = junction_m + GRIP_BEYOND_J_M / float(np.linalg.norm(along)) * along
            ways.append(nearest_m(grip_m, self.simulation.catheter.state.position_m))
        return min(ways)
