"""The rig's own law, `trocar.services.gateway.servo.servo_law`, with the rig's limits and a model that is fresh."""

from __future__ import annotations

import numpy as np

from trocar.protocol.bodies.haptics import MODEL_COLUMNS, MODEL_CONTACT, MODEL_K
from trocar.services.gateway.servo.servo_arrays import (
    LIMIT_ARM,
    LIMIT_FORCE,
    LIMIT_HANDLE,
    LIMIT_RATE,
    LIMIT_SIZE,
    MEMORY_FORCE,
    MEMORY_SIZE,
    NOW_DT,
    NOW_GAIN,
    NOW_LAST_LATE_S,
    NOW_LATE_S,
    NOW_SIZE,
    NOW_TTL,
)
from trocar.services.gateway.servo.servo_law import servo_force
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import building_kernel
from trocar.studies.feel.hands import RATE_N_S, TTL_S
from trocar.studies.feel.laws import Walls


class EnergyBound:
    """Every lane has a servo of its own."""

    def __init__(self, walls: Walls) -> None:
        self._stiffness = walls.stiffness_n_m
        self._memory = np.zeros((len(walls.stiffness_n_m), MEMORY_SIZE))
        self._limits, self._now = np.zeros(LIMIT_SIZE), np.zeros(NOW_SIZE)
        self._limits[LIMIT_FORCE], self._limits[LIMIT_RATE] = walls.file.max_force_n, RATE_N_S
        self._limits[LIMIT_ARM:LIMIT_HANDLE] = walls.file.own()
        self._now[NOW_DT], self._now[NOW_TTL], self._now[NOW_GAIN] = walls.period_s, TTL_S, 1.0
        self._now[NOW_LAST_LATE_S] = self._now[NOW_LATE_S] = walls.file.interface_delay_s

    def force(self, x_m: FloatArray, v_m_s: FloatArray) -> FloatArray:
        """Return the force, (n,)."""
        _servo_all(self._stiffness, x_m, v_m_s, self._limits, self._now, self._memory)
        return self._memory[:, MEMORY_FORCE].copy()


@building_kernel
def _servo_all(
    stiffness: FloatArray, x: FloatArray, v: FloatArray, limits: FloatArray, now: FloatArray, memory: FloatArray
) -> None:
    model, motion = np.zeros(MODEL_COLUMNS), np.zeros(6)
    for k in range(stiffness.size):
        model[MODEL_CONTACT] = 1.0 if x[k] < 0.0 else 0.0
        model[MODEL_K] = stiffness[k] if x[k] < 0.0 else 0.0
        motion[0], motion[3] = x[k], v[k]
        servo_force(model, motion, limits, now, memory[k])
