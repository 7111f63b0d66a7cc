"""The way of a driven catheter to a named branch as an environment of Gymnasium."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.scene import CatheterScene, DriveScene
from services.runtime.errors import ConfigError
from services.training.scenario import Scenario
from trocar.envs import navigation_state
from trocar.envs.hands import COLUMNS, DeviceHands, HandLimits
from trocar.envs.task import Task, TaskOptions

PUSH, TWIST, STEER = range(3)
"""Columns of an action."""


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """The fastest that a drive pushes, rolls and turns its handle; assumptions."""

    push_m_s: float = 0.05
    twist_rad_s: float = 4.0
    steer_rad_s: float = 3.0


class Navigation(Task):
    """Push, twist and steer a catheter from its proximal end until its tip is in the branch that is asked for.

    An action is (3,) in [-1, 1]: how fast the drive pushes, rolls and turns its handle, as parts of `DriveLimits`; a
    handle that steers nothing of the catheter does nothing. An observation is ``navigation_state.FIELDS`` one after the
    other, or an image as by X-rays, through the wall. The way that is rewarded goes to the mouth and on to the branch;
    what the tip goes on another branch counts against it, until it is drawn back.
    Raises ConfigError: one sentence, if something of this cannot be used.

    Args:
        scenario, observation, **options: As for `Task`; the scenario's goal is a branch, its scene has a drive.
        targets: sequence of str, optional. Ends of the duct of which each episode draws one, as ``info["target"]``
            says; None: the scenario's. The tip must come as far beyond the place where the way to it parts as the
            scenario asks on its own.
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
        """Draw the branch, and ask for it."""
        one = len(self.targets) == 1
        self.target = self.targets[0 if one else int(self.np_random.integers(len(self.targets)))]
        return {"target": self.target}

    def _asked(self) -> Scenario:
        """Return the scenario with the branch that was drawn as its goal."""
        beyond_m = self._own.depth_m - self._parted_m(self._own.branch)
        goal = replace(self._own, branch=self.target, depth_m=self._parted_m(self.target) + beyond_m)
        return replace(self.scenario, goal=goal)

    def _parted_m(self, name: str) -> float:
        """Return where the way to an end parts from the last of the others."""
        ways = self._stage.ways
        return max((ways.shared_m(name, other) for other in ways.path_m if other != name), default=0.0)

    def _new_hands(self) -> DeviceHands:
        """Return the hand of the drive, whose workspace is the way on which the catheter stays in its introducer."""
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
        """Return how far the tip has come on the way, less than nothing before the mouth, less how far it is astray."""
        _, at_m = self._stage.ways.place(self.simulation.catheter.state.position_m[-1])
        astray_m = max(at_m - self.depth_m, 0.0) if self.depth_m > 0.0 else 0.0
        return min(self.depth_m, self.scenario.goal.depth_m) - astray_m - self._to_mouth_m()


def travel_m(catheter: CatheterScene) -> float:
    """Return how far a catheter can be pushed: until its end is two segments before the exit of its introducer."""
    ahead_m = catheter.introducer_to_tip_m if catheter.anchor == "introducer" else 0.0
    return catheter.length_m * (1.0 - 2.0 / catheter.n_segments) - ahead_m
