"""One millisecond of a simulated arm in a hand: motors, links, hand, heat, encoders. Steps at 8 kHz inside.

As with a real arm, a force may reach the motors some time after it was written, and friction may be less than told.
"""

from __future__ import annotations

import math

import numpy as np

from trocar.protocol.topics import TICK_S
from trocar.services.gateway.servo.servo_arrays import READ_POSITION, READ_TEMPERATURE, READ_VELOCITY
from trocar.services.gateway.servo.velocity_filter import butterworth, low_pass
from trocar.services.gateway.simulated import premium_model
from trocar.services.gateway.simulated.premium_model import GEARS
from trocar.services.gateway.simulated.write_delay import WRITE_SIZE, WRITES, pass_time, write_late
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

SUBSTEPS = 8  # an eighth of a tick, as stops and friction change within one
#: By Maxon's datasheet of the RE25 118743: torque at stall, torque constant, resistance, its rise with temperature.
STALL_NM, TORQUE_NM_A, RESISTANCE_OHM, COPPER_1_K = 0.129, 0.0234, 2.18, 0.0039
#: By the same datasheet, winding to housing to room: K/W, J/K. The winding may reach 100 degrees.
WINDING_K_W, HOUSING_K_W, WINDING_J_K, HOUSING_J_K = 3.1, 14.0, 3.9, 43.7
ROOM_C, WINDING_MAX_C = 25.0, 100.0  # by the same datasheet
#: By the datasheet of the encoder HEDM-5500: 1024 lines, four edges each.
COUNTS = 4096

# Hand: its target, the target's velocity, stiffness, damping, and the grip force beyond which it slips.
HAND_TARGET, HAND_RATE, HAND_STIFFNESS, HAND_DAMPING, HAND_GRIP, HAND_SIZE = 0, 3, 6, 7, 8, 9


class ArmState:
    """Angles, rates and temperatures of a simulated arm, and the filter of the measured velocity.

    Args:
        angles: (3,) float64. Initial joint angles.
        velocity_filter_hz: Cut-off of the second-order Butterworth filter on the differences of encoder positions.
        friction: Its dry friction, as a share of `premium_model`'s.

    Attributes:
        given: ndarray (1,). Work of the motors on the joints so far, J.
    """

    def __init__(self, angles: FloatArray, velocity_filter_hz: float, friction: float = 1.0) -> None:
        self.angles = angles.copy()
        self.rates = np.zeros(3)
        self.heat = np.full((2, 3), ROOM_C)  # windings, housings
        self.measured = np.zeros(3)
        measure(self.angles, self.measured)
        self.filter = np.zeros((2, 3))
        self.coefficients = butterworth(velocity_filter_hz)
        self.work = np.zeros((4, 3))
        self.jacobian = np.zeros((3, 3))
        self.writes, self.given, self.friction = np.zeros((WRITES, WRITE_SIZE)), np.zeros(1), friction

    def put(self, angles: FloatArray) -> None:
        """Set the joint angles (3,), at rest, without changing temperatures."""
        self.angles[:] = angles
        self.rates[:] = 0.0
        measure(self.angles, self.measured)
        self.filter[:] = 0.0

    def step(self, force_n: FloatArray, hand: FloatArray, wait_s: float = 0.0) -> None:
        """Advance by one tick under a force (3,) of the servo, which acts after `wait_s`, and the hand (HAND_SIZE,).

        Both are in the frame of the base.
        """
        links = self.angles, self.rates, self.heat
        step_links(*links, force_n, wait_s, hand, self.friction, self.writes, self.given, self.work, self.jacobian)

    def read(self, centre: FloatArray, reading: FloatArray) -> None:
        """Write the readings of encoders and temperature model into `reading`; call this once a tick."""
        filter_reading(self.angles, self.measured, self.filter, self.coefficients, centre, reading)
        reading[READ_TEMPERATURE] = hottest(self.heat)


@kernel
def step_links(
    angles: FloatArray,
    rates: FloatArray,
    heat: FloatArray,
    force: FloatArray,
    wait_s: float,
    hand: FloatArray,
    friction: float,
    writes: FloatArray,
    given: FloatArray,
    work: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Advance by TICK_S, and add the motors' work to `given`.

    Semi-implicit Euler, stable up to hand and stop stiffnesses of about 30 kN/m.
    """
    motor, torque, out, point = work[0], work[1], work[2], work[3]
    premium_model.jacobian(angles, jacobian)
    for joint in range(3):
        wanted = (
            jacobian[0, joint] * force[0] + jacobian[1, joint] * force[1] + jacobian[2, joint] * force[2]
        ) / GEARS[joint]
        motor[joint] = min(max(wanted, -STALL_NM), STALL_NM)
    _warm(motor, heat)
    write_late(writes, motor[0], motor[1], motor[2], wait_s)
    dt = TICK_S / SUBSTEPS
    for k in range(SUBSTEPS):
        premium_model.forward(angles, point)
        premium_model.jacobian(angles, jacobian)
        pass_time(writes, dt, motor)
        _hand_force(point, jacobian, rates, hand, (k + 1) * dt - TICK_S, out)
        for joint in range(3):
            torque[joint] = motor[joint] * GEARS[joint] + premium_model.passive_torque(angles, rates, joint)
            torque[joint] += jacobian[0, joint] * out[0] + jacobian[1, joint] * out[1] + jacobian[2, joint] * out[2]
        premium_model.accelerate(angles, rates, torque, out)
        for joint in range(3):
            rates[joint] += dt * out[joint]
        premium_model.rub(angles, rates, dt, friction)
        for joint in range(3):
            angles[joint] += dt * rates[joint]
            given[0] += motor[joint] * GEARS[joint] * dt * rates[joint]


@kernel
def _hand_force(
    point: FloatArray, jacobian: FloatArray, rates: FloatArray, hand: FloatArray, ahead: float, out: FloatArray
) -> None:
    norm2 = 0.0
    for i in range(3):
        velocity = jacobian[i, 0] * rates[0] + jacobian[i, 1] * rates[1] + jacobian[i, 2] * rates[2]
        target = hand[HAND_TARGET + i] + ahead * hand[HAND_RATE + i]
        out[i] = hand[HAND_STIFFNESS] * (target - point[i]) + hand[HAND_DAMPING] * (hand[HAND_RATE + i] - velocity)
        norm2 += out[i] * out[i]
    if norm2 > hand[HAND_GRIP] ** 2:
        slip = hand[HAND_GRIP] / math.sqrt(norm2)
        for i in range(3):
            out[i] *= slip


@kernel
def _warm(motor: FloatArray, heat: FloatArray) -> None:
    """Two-node heat model of each motor over TICK_S; time constants of 12 s and 10 min, so Euler is exact enough."""
    for joint in range(3):
        winding, housing = heat[0, joint], heat[1, joint]
        power = (motor[joint] / TORQUE_NM_A) ** 2 * RESISTANCE_OHM * (1.0 + COPPER_1_K * (winding - ROOM_C))
        out = (winding - housing) / WINDING_K_W
        heat[0, joint] += TICK_S * (power - out) / WINDING_J_K
        heat[1, joint] += TICK_S * (out - (housing - ROOM_C) / HOUSING_K_W) / HOUSING_J_K


@kernel
def hottest(heat: FloatArray) -> float:
    """Return the temperature of the warmest winding: 0 at room temperature, 1 at its limit."""
    return float((max(heat[0, 0], heat[0, 1], heat[0, 2]) - ROOM_C) / (WINDING_MAX_C - ROOM_C))


@kernel
def place_hand(value: FloatArray, rate: FloatArray, stand: FloatArray, hand: FloatArray) -> None:
    """Transform a script's target in the world to the frame of the arm's base.

    Args:
        value, rate: (3+,) float64. Position and velocity in the world.
        stand: (8,) float64. Cosine and sine of the arm's yaw, its centre in the world, its centre in the frame of its
            base.
        hand: (HAND_SIZE,) float64
    """
    c, s = stand[0], stand[1]
    x, y = value[0] - stand[2], value[1] - stand[3]
    hand[HAND_TARGET] = stand[5] + c * x + s * y
    hand[HAND_TARGET + 1] = stand[6] + c * y - s * x
    hand[HAND_TARGET + 2] = stand[7] + value[2] - stand[4]
    hand[HAND_RATE] = c * rate[0] + s * rate[1]
    hand[HAND_RATE + 1] = c * rate[1] - s * rate[0]
    hand[HAND_RATE + 2] = rate[2]


@kernel
def tremble(hand: FloatArray, tremor_m: float, time_s: float) -> None:
    """Add a tremor of at most ``tremor_m`` along each axis to the hand's target, (HAND_SIZE,).

    It is the sum of two sines: physiological tremor is at 8 to 12 Hz, and 0.1 to 0.2 mm in a hand that holds an
    instrument (Harwell and Ferguson, Microsurgery 4, 1983; Riviere, Rader and Khosla, EMBS 1997).
    """
    for axis in range(3):
        for k in range(2):
            omega = 2.0 * math.pi * (9.3 + 1.8 * k)
            phase = omega * time_s + 2.1 * axis + k
            hand[HAND_TARGET + axis] += 0.5 * tremor_m * math.sin(phase)
            hand[HAND_RATE + axis] += 0.5 * tremor_m * omega * math.cos(phase)


@kernel
def measure(angles: FloatArray, out: FloatArray) -> None:
    """Write the end point by the encoders into `out` (3,), with angles rounded down to whole counts."""
    seen = (
        math.floor(angles[0] * COUNTS * GEARS[0] / (2 * math.pi)) * 2 * math.pi / (COUNTS * GEARS[0]),
        math.floor(angles[1] * COUNTS * GEARS[1] / (2 * math.pi)) * 2 * math.pi / (COUNTS * GEARS[1]),
        math.floor(angles[2] * COUNTS * GEARS[2] / (2 * math.pi)) * 2 * math.pi / (COUNTS * GEARS[2]),
    )
    premium_model.forward(seen, out)


@kernel
def filter_reading(
    angles: FloatArray,
    measured: FloatArray,
    state: FloatArray,
    coefficients: FloatArray,
    centre: FloatArray,
    reading: FloatArray,
) -> None:
    """Write measured position (from `centre`) and filtered velocity into `reading`; `measured` is the last position."""
    x0, y0, z0 = measured[0], measured[1], measured[2]
    measure(angles, measured)
    last = (x0, y0, z0)
    for i in range(3):
        reading[READ_POSITION + i] = measured[i] - centre[i]
        reading[READ_VELOCITY + i] = low_pass((measured[i] - last[i]) / TICK_S, state, i, coefficients)
