"""Hands of an agent: the device end of each instrument, within the limits of a hand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.scene import ToolScene
from trocar.services.mechanics.scene.tools import N_TOOLS, ToolInputs

COLUMNS = 5
"""Columns of an action and of `DeviceHands.state`, a row a tool: junction J (3), roll, opening of the handle."""


@dataclass(frozen=True, slots=True)
class HandLimits:
    """Largest rates of J along any axis, of the roll and of the handle; assumptions.

    ``reach_m`` is the largest distance of J from the middle of the device's workspace, ``most_roll_rad`` the largest
    turn of the wrist in either direction.
    """

    speed_m_s: float = 0.1
    roll_rad_s: float = 3.0
    handle_rad_s: float = 3.0
    reach_m: float = 0.08
    most_roll_rad: float = math.pi

    @property
    def rates(self) -> FloatArray:
        """Rates (5,) of an action of 1: J in m/s, roll and handle in rad/s."""
        return np.array([*(self.speed_m_s,) * 3, self.roll_rad_s, self.handle_rad_s])


class HandArrays(Struct):
    """Arguments of the kernel that moves both hands."""

    state: Annotated[FloatArray, N_TOOLS, COLUMNS]
    rate: Annotated[FloatArray, N_TOOLS, COLUMNS]
    jaw_ratio: Annotated[FloatArray, N_TOOLS]
    jaw_most: Annotated[FloatArray, N_TOOLS]
    position: Annotated[FloatArray, N_TOOLS, 3]
    roll: Annotated[FloatArray, N_TOOLS]
    opening: Annotated[FloatArray, N_TOOLS]
    middle: Annotated[FloatArray, 3]
    reach_m: float
    most_roll: float
    n_tools: int


hand_arrays_at = reader(HandArrays)


class DeviceHands:
    """Both hands: state and rates of their devices.

    Attributes:
        state, rate: (2, 5) float64. J in m and m/s in scene axes, roll and handle in rad and rad/s.
        inputs: ToolInputs. The same for a simulation.
        middle_m: list of float. Middle of the workspace, in scene axes; for an insertion the mouth.
    """

    def __init__(self, tools: tuple[ToolScene, ...], limits: HandLimits, middle_m: FloatArray) -> None:
        self.limits, self.n_tools = limits, len(tools)
        self.middle_m: list[float] = middle_m.tolist()
        self.inputs = inputs = ToolInputs()
        inputs.present[: self.n_tools] = True
        ranges = [tool.handle_range for tool in tools]
        self._hands = HandArrays.zeros(
            position=inputs.position_m, roll=inputs.roll_rad, opening=inputs.jaw_angle_rad, middle=middle_m.copy()
        )
        self._hands.n_tools, self._hands.reach_m = self.n_tools, limits.reach_m
        self._hands.most_roll = limits.most_roll_rad
        self._hands.jaw_ratio[: self.n_tools] = [ratio for ratio, _ in ranges]
        self._hands.jaw_most[: self.n_tools] = [most for _, most in ranges]
        self.state, self.rate = self._hands.state, self._hands.rate

    def set_start(self, start: ToolInputs) -> None:
        """Set the hands to their start."""
        self.state[:], self.rate[:] = self.state_of(start), 0.0
        self.move(0.0)

    def state_of(self, inputs: ToolInputs) -> FloatArray:
        """Return the state (2, 5) of the devices for some inputs."""
        state = np.zeros((N_TOOLS, COLUMNS))
        n = self.n_tools
        state[:n, :3], state[:n, 3] = inputs.position_m[:n], inputs.roll_rad[:n]
        state[:n, 4] = inputs.jaw_angle_rad[:n] / self._hands.jaw_ratio[:n]
        return state

    def steer(self, action: FloatArray) -> None:
        """Set rates (tools, 5), each from -1 to 1 of the limits."""
        self.rate[: self.n_tools] = np.clip(action, -1.0, 1.0) * self.limits.rates

    def move(self, dt_s: float) -> None:
        """Move at these rates, within workspace and handle's range."""
        move_hands(self._hands.address, dt_s)


@kernel
def move_hands(address: Address[HandArrays], dt_s: float) -> None:
    """Kernel of `DeviceHands.move`, which also writes the inputs of a simulation."""
    hands = hand_arrays_at(address)
    for tool in range(hands.n_tools):
        state, rate = hands.state[tool], hands.rate[tool]
        away_2 = 0.0
        for axis in range(3):
            state[axis] += dt_s * rate[axis]
            away_2 += (state[axis] - hands.middle[axis]) ** 2
        share = min(1.0, hands.reach_m / math.sqrt(away_2)) if away_2 > 0.0 else 1.0
        for axis in range(3):
            if share < 1.0:
                state[axis] = hands.middle[axis] + share * (state[axis] - hands.middle[axis])
            hands.position[tool, axis] = state[axis]
        ratio, most = hands.jaw_ratio[tool], hands.jaw_most[tool]
        hands.roll[tool] = state[3] = min(max(state[3] + dt_s * rate[3], -hands.most_roll), hands.most_roll)
        state[4] = min(max(state[4] + dt_s * rate[4], 0.0), most / ratio)
        hands.opening[tool] = min(ratio * state[4], most)
