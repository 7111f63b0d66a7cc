"""What an agent moves: the device end of each instrument, within what a hand can do."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.scene import ToolScene
from services.mechanics.scene.tools import N_TOOLS, ToolInputs

COLUMNS = 5
"""Of an action and of `DeviceHands.state`, a row a tool: three of the junction J, roll, opening of the handle."""


@dataclass(frozen=True, slots=True)
class HandLimits:
    """The fastest that a hand moves J in any axis, turns the instrument and opens its handle; assumptions.

    ``reach_m`` is how far from the mouth J may be led: the workspace of the device.
    """

    speed_m_s: float = 0.1
    roll_rad_s: float = 3.0
    handle_rad_s: float = 3.0
    reach_m: float = 0.08

    @property
    def rates(self) -> FloatArray:
        """Rates (5,) of an action of 1: J in m/s, roll and handle in rad/s."""
        return np.array([*(self.speed_m_s,) * 3, self.roll_rad_s, self.handle_rad_s])


class DeviceHands:
    """Both hands: where their devices are, and how fast they move.

    Attributes
    ----------
    state, rate : (2, 5) float64
        J in m and m/s in scene axes, roll and handle in rad and rad/s.
    inputs : ToolInputs
        The same for a simulation.
    mouth_m : list of float
        Middle of the workspace, in scene axes.
    """

    def __init__(self, tools: tuple[ToolScene, ...], limits: HandLimits, mouth_m: FloatArray) -> None:
        jaws = [tool.jaws for tool in tools]
        self.limits = limits
        self.n_tools = len(tools)
        self.mouth_m: list[float] = mouth_m.tolist()
        self._jaw_ratio = np.array([each.jaw_ratio if each else 1.0 for each in jaws])
        self._most = np.full((N_TOOLS, COLUMNS), np.inf)
        self._most[:, 3] = np.pi
        self._jaw_most = np.array([each.jaw_max_angle_rad if each else 0.0 for each in jaws])
        self._most[: self.n_tools, 4] = self._jaw_most / self._jaw_ratio
        self._least = np.where(np.arange(COLUMNS) < 4, -self._most, 0.0)
        self.state, self.rate = np.zeros((2, N_TOOLS, COLUMNS))
        self.inputs = ToolInputs()
        self.inputs.present[:] = np.arange(N_TOOLS) < self.n_tools

    def begin(self, start: ToolInputs) -> None:
        """Take hands as they are to begin."""
        self.state[:], self.rate[:] = self.state_of(start), 0.0
        self._write()

    def state_of(self, inputs: ToolInputs) -> FloatArray:
        """Return the state (2, 5) of the devices that such inputs come from."""
        state = np.zeros((N_TOOLS, COLUMNS))
        n = self.n_tools
        state[:n, :3], state[:n, 3] = inputs.position_m[:n], inputs.roll_rad[:n]
        state[:n, 4] = inputs.jaw_angle_rad[:n] / self._jaw_ratio
        return state

    def steer(self, action: FloatArray) -> None:
        """Take rates (tools, 5), each from -1 to 1 of the limits."""
        self.rate[: self.n_tools] = np.clip(action, -1.0, 1.0) * self.limits.rates

    def move(self, dt_s: float) -> None:
        """Move on at these rates, as far as workspace and handle let them."""
        n = self.n_tools
        state = self.state[:n]
        state += dt_s * self.rate[:n]
        for tool, place_m in enumerate(state[:, :3].tolist()):
            distance_m = math.dist(place_m, self.mouth_m)
            if distance_m > self.limits.reach_m:
                away_m = state[tool, :3] - self.mouth_m
                state[tool, :3] = self.mouth_m + self.limits.reach_m / distance_m * away_m
        np.maximum(state, self._least[:n], out=state)
        np.minimum(state, self._most[:n], out=state)
        self._write()

    def _write(self) -> None:
        n = self.n_tools
        self.inputs.position_m[:], self.inputs.roll_rad[:] = self.state[:, :3], self.state[:, 3]
        np.minimum(self._jaw_ratio * self.state[:n, 4], self._jaw_most, out=self.inputs.jaw_angle_rad[:n])
