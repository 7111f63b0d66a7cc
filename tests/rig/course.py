"""What a rig said of a scenario that its hands play."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from tests.rig.conftest import Observer
from trocar.protocol.bodies import Catheter, GatewayState, PhysicsState

PACE = 0.5
"""Of the hands: where a busy machine loses ticks they move on by less."""
FORCE_STEP_N = 0.3
DEEPEST_M = 0.1e-3


def hands(name: str) -> list[str]:
    """Return the settings of devices that follow a scenario."""
    return [
        f"gateway.instruments.{i}.{device}.settings={{scenario: {name}, pace: {PACE}}}"
        for i in (0, 1)
        for device in ("arm", "grasp")
    ]


@dataclass
class Course:
    """Everything that gateway and physics said of a scenario."""

    devices: list[GatewayState]
    states: list[PhysicsState]

    @classmethod
    def of(cls, observer: Observer) -> Self:
        """Return what an observer hears that keeps all; it grows."""
        assert observer.devices is not None
        assert observer.solved is not None
        return cls(observer.devices, observer.solved)

    def reaches(self, inserted_m: float) -> bool:
        return bool(self.states) and self.states[-1].catheter.inserted_length_m >= inserted_m

    def is_bowed(self, by_m: float) -> bool:
        return bool(self.states) and _bow_m(self.states[-1].catheter) > by_m

    def deepest_m(self) -> float:
        """Return how deep anything was in anything."""
        return max(body.contacts.max_penetration_m for body in self.states)

    def largest_step_n(self) -> float:
        """Return the largest change of a tool's force between neighbouring ticks."""
        return max(
            math.dist(x.force_n, y.force_n)
            for a, b in itertools.pairwise(self.states)
            if b.tick == a.tick + 1 and a.tools.shape == b.tools.shape
            for x, y in zip(a.reactions(), b.reactions(), strict=True)
        )


def _bow_m(body: Catheter) -> float:
    """Return how much shorter the straight line is than the 35 mm of catheter before its tip."""
    x = body.position_m.view()
    arc_m = np.cumsum(np.linalg.norm(np.diff(x[::-1], axis=0), axis=1))
    last = int(np.searchsorted(arc_m, 35e-3))
    return float(arc_m[last] - np.linalg.norm(x[-1] - x[-2 - last]))
