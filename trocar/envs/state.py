"""What an agent is told of the scene as numbers: the observation of mode ``state``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import Float32Array, FloatArray
from services.mechanics.scene.tools import N_TOOLS
from services.mechanics.simulation import Simulation
from trocar.envs.hands import DeviceHands

N_POINTS = 6
SPACING_M = 8e-3
_CATHETER = 1


class Field(NamedTuple):
    """A part of the observation: its shape, its unit, the largest size of its numbers, and what it is.

    Numbers beyond that size are cut off.
    """

    name: str
    shape: tuple[int, ...]
    unit: str
    most: float
    what: str


FIELDS = (
    Field("junction", (N_TOOLS, 3), "m", 0.2, "J of each tool from the mouth at rest"),
    Field("roll", (N_TOOLS,), "rad", 3.15, "of each tool about its shaft"),
    Field("handle", (N_TOOLS,), "rad", 3.15, "opening of each handle"),
    Field("jaws", (N_TOOLS,), "rad", 3.15, "opening at which each tool's jaws are"),
    Field("force", (N_TOOLS, 3), "N", 20.0, "on each tool at J"),
    Field("holds_catheter", (N_TOOLS,), "1", 1.0, "1 where a tool holds the catheter"),
    Field("holds_duct", (N_TOOLS,), "1", 1.0, "1 where a tool holds the duct"),
    Field("catheter", (N_POINTS, 3), "m", 0.3, "points of the catheter from the mouth at rest, tip first, 8 mm apart"),
    Field("mouth", (3,), "m", 0.1, "how far the mouth's middle has moved"),
    Field("inserted", (1,), "m", 0.3, "length of catheter in the lumen"),
    Field("time", (1,), "s", 1000.0, "since the beginning"),
)
"""Axes are those of the scene."""

SIZE = sum(int(np.prod(each.shape)) for each in FIELDS)
MOST: Float32Array = np.concatenate([np.full(int(np.prod(f.shape)), f.most, np.float32) for f in FIELDS])


def places() -> dict[str, slice]:
    """Return where each field lies in the observation."""
    ends = np.cumsum([0, *(int(np.prod(each.shape)) for each in FIELDS)]).tolist()
    return {each.name: slice(a, b) for each, a, b in zip(FIELDS, ends[:-1], ends[1:], strict=True)}


class StateView:
    """Reads the observation from a simulation.

    Parameters
    ----------
    mouth_m : (3,) float64
        Middle of the mouth at rest.
    mouth_modes : (3, r) float64
        By how much it moves with each mode, in 1/sqrt(kg).
    """

    def __init__(self, simulation: Simulation, hands: DeviceHands, mouth_m: FloatArray, mouth_modes: FloatArray) -> None:
        self._simulation, self._hands = simulation, hands
        self._mouth_m, self._mouth_modes = mouth_m, mouth_modes
        catheter = simulation.catheter.properties
        step = max(1, round(SPACING_M / catheter.segment_length_m))
        self._points = np.maximum(catheter.n_particles - 1 - step * np.arange(N_POINTS), 0)

    def read(self, time_s: float, inserted_m: float) -> Float32Array:
        """Return the observation (`SIZE`,) as float32."""
        s, hands = self._simulation, self._hands.state
        held = np.zeros((2, N_TOOLS))
        for grasp in s.grasps:
            for hold in grasp.holds:
                held[0 if hold.target_kind == _CATHETER else 1, grasp.tool] = 1.0
        here = np.arange(N_TOOLS)[:, None] < self._hands.n_tools
        parts = (
            np.where(here, hands[:, :3] - self._mouth_m, 0.0), hands[:, 3], hands[:, 4],
            s.tool_results.proxy_jaw_angle_rad, s.tool_results.force_n, held,
            s.catheter.state.position_m[self._points] - self._mouth_m,
            self._mouth_modes @ s.duct_state.q[: self._mouth_modes.shape[1]], (inserted_m, time_s),
        )  # fmt: skip
        told = np.concatenate([np.ravel(part) for part in parts]).astype(np.float32)
        return np.clip(told, -MOST, MOST, out=told)
