"""The expert as a policy: the path of `trocar.expert` in the scene, in the environment's actions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import trocar
from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.meshes.tube_paths import TubePaths

if TYPE_CHECKING:
    from trocar.envs.task import Task

_SAMPLE_S = 10e-3
_WAY = "hands"


class Expert:
    """Moves the hands along the path of the scripted ones, without their rests.

    An action depends on the hands' pose and the catheter's depth, which are in the observation, and not on the time, so
    a cloned policy never waits.

    Args:
        env: Task. ``env.unwrapped`` of an environment, after its reset.
        effort: float. Length of an action along the path.
        beyond_m: float. Distance beyond the goal's depth at which it stops.
    """

    def __init__(self, env: Task, effort: float = 0.2, beyond_m: float = 3e-3) -> None:
        self._env, self._effort = env, effort
        self._enough_m = env.scenario.goal.depth_m + beyond_m
        motion, inputs, places = trocar.expert(env.simulation), ToolInputs(), []
        for time_s in np.arange(0.0, motion.duration_s + _SAMPLE_S, _SAMPLE_S):
            motion.write_inputs(float(time_s), inputs)
            places.append(self._place(env.hands.state_of(inputs)))
        moves = np.any(np.diff(places, axis=0), axis=1)
        self._way = TubePaths({_WAY: np.array(places)[np.concatenate([[True], moves])]})

    def action(self) -> Float32Array:
        """Return the present action."""
        env = self._env
        if env.depth_m > self._enough_m:
            return np.zeros(env.action_space.shape or (), np.float32)
        here = self._place(env.hands.state)
        ahead = self._way.place(here)[1] + self._effort * env.step_s
        path, arc = self._way.path_m[_WAY], self._way.arc_m[_WAY]
        there = np.array([np.interp(ahead, arc, axis) for axis in path.T])
        action = ((there - here) / env.step_s).reshape(env.action_space.shape or ())
        return np.clip(action, -1.0, 1.0).astype(np.float32)

    def _place(self, state: FloatArray) -> FloatArray:
        """Return the hands' state (2, 5) in units of an action of 1 for a second."""
        hands = self._env.hands
        return self._env.action_of(state[: hands.n_tools] / hands.limits.rates).ravel()
