"""Practised hands as a policy: what `trocar.expert` does in the scene, in the actions of the environment."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import trocar
from services.mechanics.arrays import Float32Array
from services.mechanics.scene.tools import ToolInputs

if TYPE_CHECKING:
    from trocar.envs.task import Task


class Expert:
    """Leads the hands to where the scripted ones are at the end of each step.

    Args:
        env: Task. ``env.unwrapped`` of a made environment, after its reset.
        pace: float. Of the script.
        beyond_m: float. How far beyond the goal's depth it pushes; then it holds still.
    """

    def __init__(self, env: Task, pace: float = 0.5, beyond_m: float = 3e-3) -> None:
        self._env, self._pace = env, pace
        self._enough_m = env.scenario.goal.depth_m + beyond_m
        self._motion = trocar.expert(env.simulation)
        self._inputs = ToolInputs()

    def action(self) -> Float32Array:
        """Return the action of now."""
        env = self._env
        if env.depth_m > self._enough_m:
            return np.zeros(env.action_space.shape or (), np.float32)
        time_s = min(self._pace * (env.time_s + env.step_s), self._motion.duration_s)
        self._motion.write_inputs(time_s, self._inputs)
        way = env.hands.state_of(self._inputs) - env.hands.state
        rates = way[: env.hands.n_tools] / (env.step_s * env.hands.limits.rates)
        return np.clip(env.action_of(rates), -1.0, 1.0).astype(np.float32)
