"""Navigation of a driven catheter to a named branch as an environment of Gymnasium."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

import numpy as np

from trocar.envs import navigation_state
from trocar.envs.hands import COLUMNS, DeviceHands, HandLimits
from trocar.envs.task import Task, TaskOptions
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene import CatheterScene, DriveScene
from trocar.services.runtime.errors import ConfigError
from trocar.services.training.scenario import Scenario

PUSH, TWIST, STEER = range(3)
"""Columns of an action."""


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """Largest rates of a drive's push, roll and handle; assumptions."""

    push_m_s: float = 0.05
    twist_rad_s: float = 4.0
    steer_rad_s: float = 3.0


class Navigation(Task):
    """Push, twist and steer a catheter from its proximal end until its tip is in the target branch.

    An action is (3,) in [-1, 1]: rates of the drive's push, roll and handle, as fractions of `DriveLimits`; the handle
    has no effect on an unsteered catheter. An observation is the concatenation of ``navigation_state.FIELDS``, or an
    X-ray-like image through the wall. The rewarded path goes to the mouth and on to the branch; the distance into
    another branch counts negative until it is withdrawn. Raises ConfigError: one sentence, if an argument is invalid.

    Args:
        scenario, observation, **options: As in `Task`; the scenario's goal is a branch, its scene has a drive.
        targets: sequence of str, optional. Ends of the duct of which each episode draws one, reported in
            ``info["target"]``; None for the scenario's. The required depth beyond the fork is the scenario's.
        limits: DriveLimits
    """

    view_name = "fluoroscopy"

    def __init__(
        self,
        scenario: str | Path = "bronchoscopy",
        observation: str = "state",
        *,
        targets: Sequence[str] | None = None,
        limits: DriveLimits | None = None,
        **options: Unpack[TaskOptions],
    ) -> None:
        super().__init__(scenario, observation, **options)
        name, own = self.scenario.name, self.scenario.goal
        if not own.branch:
            raise ConfigError(f"scenario {name}: its goal is no branch that a catheter could be led to")
        if not any(isinstance(tool, DriveScene) for tool in self._stage.scene.forceps):
            raise ConfigError(f"scenario {name}: its scene has no drive that an agent could move")
        self._limits, self._own = limits or DriveLimits(), own
        self.targets = tuple(targets or (own.branch,))
        for each in (own.branch, *self.targets):
            self._stage.site.check_branch(each)
        if self._is_image and len(self.targets) > 1:
            raise ConfigError("targets: an image does not show which one is meant, name one")
        self._declare((3,), navigation_state.MOST)

    def action_of(self, rates: FloatArray) -> FloatArray:
        """Return push, twist and steering of the drive among hands at these rates."""
        push, twist, steer = float(rates[self._at, :3] @ self._along), rates[self._at, 3], rates[self._at, 4]
        return np.array([push, twist, steer])

    def _rates_of(self, action: FloatArray) -> FloatArray:
        rates = np.zeros((self.hands.n_tools, COLUMNS))
        push, twist, steer = np.clip(action, -1.0, 1.0)
        rates[self._at] = *(push * self._along), twist, steer
        return rates

    def _draw_task(self) -> dict[str, str]:
        """Draw the target branch."""
        one = len(self.targets) == 1
        self.target = self.targets[0 if one else int(self.np_random.integers(len(self.targets)))]
        return {"target": self.target}

    def _asked(self) -> Scenario:
        """Return the scenario with the drawn branch as its goal."""
        beyond_m = self._own.depth_m - self._parted_m(self._own.branch)
        goal = replace(self._own, branch=self.target, depth_m=self._parted_m(self.target) + beyond_m)
        return replace(self.scenario, goal=goal)

    def _parted_m(self, name: str) -> float:
        """Return the distance along the path to an end at which it leaves the last of the others."""
        ways = self._stage.ways
        return max((ways.shared_m(name, other) for other in ways.path_m if other != name), default=0.0)

    def _new_hands(self) -> DeviceHands:
        """Return the hand of the drive, with the travel that keeps the catheter in its introducer as its workspace."""
        scene, limits = self.simulation.scene, self._limits
        self._at = next(k for k, tool in enumerate(scene.forceps) if isinstance(tool, DriveScene))
        self._along = np.array(scene.catheter.direction) / float(np.linalg.norm(scene.catheter.direction))
        half_m = 0.5 * travel_m(scene.catheter)
        end_m = np.array(scene.catheter.tip_position_m) - scene.catheter.length_m * self._along
        hand = HandLimits(limits.push_m_s, limits.twist_rad_s, limits.steer_rad_s, half_m, math.inf)
        return DeviceHands(scene.forceps, hand, end_m + half_m * self._along)

    def _new_view(self) -> navigation_state.NavigationView:
        behind_m = self._stage.scene.forceps[self._at].behind_m  # type: ignore[attr-defined]
        return navigation_state.NavigationView(self._stage.site, self.scenario.goal, self._at, behind_m)

    def _way_m(self) -> float:
        """Return the progress along the path, negative before the mouth, less the distance into a wrong branch."""
        _, at_m = self._stage.ways.place(self.simulation.catheter.state.position_m[-1])
        astray_m = max(at_m - self.depth_m, 0.0) if self.depth_m > 0.0 else 0.0
        return min(self.depth_m, self.scenario.goal.depth_m) - astray_m - self._to_mouth_m()


def travel_m(catheter: CatheterScene) -> float:
    """Return the travel of a catheter, until its end is two segments before the exit of its introducer."""
    ahead_m = catheter.introducer_to_tip_m if catheter.anchor == "introducer" else 0.0
    return catheter.length_m * (1.0 - 2.0 / catheter.n_segments) - ahead_m
