"""A virtual hand that holds a tool for input devices without force: a mass on a spring, which yields to contact.

A mouse can move anywhere. It moves the far end of a spring; the tool is a mass driven by the near end and by its
contact force. So a tool pushed into a wall presses no harder than the hand's grip.
"""

from __future__ import annotations

import math

import numpy as np

from trocar.protocol.topics import TICK_S
from trocar.services.gateway.servo.pose import to_arm
from trocar.services.gateway.servo.servo_arrays import READ_POSITION, READ_VELOCITY
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

#: Critically damped at 10 Hz: quick enough for a hand, slow enough to smooth a mouse's steps.
MASS_KG, STIFFNESS_N_M = 0.1, 400.0
DAMPING_N_S_M = 2.0 * math.sqrt(MASS_KG * STIFFNESS_N_M)
#: Largest force of the spring: it limits the speed towards a far target to 0.32 m/s (by `DAMPING_N_S_M`), and the force
#: on a wall to less than twice that of an error.
GRIP_N = 4.0

# State of a hand: position and velocity in the world.
POSITION, VELOCITY, STATE_SIZE = 0, 3, 6


@kernel
def step_hand(state: FloatArray, target: FloatArray, force: FloatArray) -> None:
    """Advance `state` (STATE_SIZE,) by TICK_S toward `target` (3,) under the tool's contact force (3,); world axes.

    Semi-implicit Euler is stable for contact stiffnesses up to 4 m / dt^2 = 400 kN/m, and the damping dissipates the
    energy that a step may add to a contact up to b / dt = 12 kN/m.
    """
    stretch = math.sqrt((target[0] - state[0]) ** 2 + (target[1] - state[1]) ** 2 + (target[2] - state[2]) ** 2)
    stiffness = STIFFNESS_N_M
    if stiffness * stretch > GRIP_N:
        stiffness = GRIP_N / stretch
    for i in range(3):
        pull = stiffness * (target[i] - state[POSITION + i]) - DAMPING_N_S_M * state[VELOCITY + i]
        state[VELOCITY + i] += TICK_S / MASS_KG * (pull + force[i])
        state[POSITION + i] += TICK_S * state[VELOCITY + i]


@kernel
def read_hand(state: FloatArray, mount: FloatArray, reading: FloatArray) -> None:
    """Write position and velocity of a hand into `reading`, in the frame of an arm on this mount (see `pose`)."""
    for axis in range(3):
        reading[READ_POSITION + axis] = state[POSITION + axis] - mount[2 + axis]
    to_arm(reading, READ_POSITION, mount, reading, READ_POSITION)
    to_arm(state, VELOCITY, mount, reading, READ_VELOCITY)


def within(target: FloatArray, centre: FloatArray, reach_m: float) -> FloatArray:
    """Return the point nearest to `target` (3,) that is at most `reach_m` from `centre` (3,)."""
    away = np.clip(target - centre, -1e3, 1e3)  # prevents an overflow of the square
    distance = float(np.linalg.norm(away))
    return target if distance <= reach_m else centre + away * (reach_m / distance)
