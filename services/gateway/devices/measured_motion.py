"""Position and velocity of an arm from samples of another program, each of which may be wrong, late or missing."""

from __future__ import annotations

import math

import numpy as np

from trocar.protocol.topics import TICK_S
from trocar.services.gateway.devices.hand_reach import FURTHEST_M, REACH_M_S
from trocar.services.gateway.servo.servo_arrays import READ_POSITION, READ_VELOCITY
from trocar.services.gateway.servo.velocity_filter import design, low_pass
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config.rig import Vector3

#: Share of a newest interval in the mean, and by how much the mean may differ from what the filter is designed for.
_NEWEST, _NEARLY = 0.02, 0.1
#: After a longer time without a sample the velocity is not known.
_LONG_S = 0.02


class MeasuredMotion:
    """The newest place that a hand may have reached. The velocity is of differences: nobody else tells it.

    Attributes:
        strange: int. Number of samples that were not believed.
        sampled_ns: int. When the newest believed place was, 0 before the first.
        period_s: float. Mean time between believed places of late.
    """

    def __init__(self, cut_off_hz: float) -> None:
        self.strange = 0
        self.sampled_ns = 0
        self.period_s = TICK_S
        self._cut_off_hz, self._designed_s = cut_off_hz, TICK_S
        self._coefficients, self._filter = np.zeros(5), np.zeros((2, 3))
        design(cut_off_hz, TICK_S, self._coefficients)
        self._place: Vector3 = (0.0, 0.0, 0.0)
        self._velocity = [0.0, 0.0, 0.0]

    def forget(self) -> None:
        """Believe the next place wherever it is, as the arm was opened anew."""
        self.sampled_ns = 0
        self.rest()

    def rest(self) -> None:
        """Keep the place, without velocity, as nothing is heard of the arm."""
        self._filter[:] = 0.0
        self._velocity[:] = 0.0, 0.0, 0.0

    def take(self, place: Vector3, sampled_ns: int) -> bool:
        """Take a place (m, from the middle of the workspace); return whether it is believed."""
        passed_s = 1e-9 * (sampled_ns - self.sampled_ns)
        if not all(map(_is_near, place)) or (self.sampled_ns and not self._is_within_reach(place, passed_s)):
            self.strange += 1
            return False
        if not self.sampled_ns or passed_s > _LONG_S:
            self.rest()
        else:
            self._differentiate(place, passed_s)
        self._place, self.sampled_ns = place, sampled_ns
        return True

    def write(self, reading: FloatArray) -> None:
        """Write place and velocity into a reading, see `servo_arrays`."""
        reading[READ_POSITION : READ_POSITION + 3] = self._place
        reading[READ_VELOCITY : READ_VELOCITY + 3] = self._velocity

    def _is_within_reach(self, place: Vector3, passed_s: float) -> bool:
        return passed_s > 0.0 and math.dist(place, self._place) <= REACH_M_S * passed_s

    def _differentiate(self, place: Vector3, passed_s: float) -> None:
        self.period_s += _NEWEST * (passed_s - self.period_s)
        if abs(self.period_s - self._designed_s) > _NEARLY * self._designed_s:
            self._designed_s = self.period_s
            design(self._cut_off_hz, self.period_s, self._coefficients)
        for axis in range(3):
            raw = (place[axis] - self._place[axis]) / passed_s
            self._velocity[axis] = low_pass(raw, self._filter, axis, self._coefficients)


def _is_near(coordinate_m: float) -> bool:
    return abs(coordinate_m) <= FURTHEST_M  # false for what is not a number
