r"""A virtual wall on a one-axis device, rendered by the servo's law: what is stable, what is passive, what theory says.

The device is a mass with friction b, whose motion under a force that is held for a period T is exact; the force is what
`servo_law.servo_force` writes, some periods late where a delay is asked for. Two questions, two borders:

* *Passive with any hand* (Colgate and Schenkel, J. Robotic Systems 14(1), 1997): :math:`b > KT/2 + |B|`, and with a
  delay :math:`t_d` of the loop :math:`b > K(T/2 + t_d) + |B|`. Measured by moving the device through the samples of
  sinusoids up to half the rate and taking the worst of the energy that comes out over what 1 N s/m would take.
* *Stable by itself*, no hand: for :math:`K T^2 \ll m` the sum of friction and damping has to outdo what the hold and
  the delay put in, :math:`b + B > K (T/2 + t_d)` (Gil, Sanchez, Hulin, Preusche and Hirzinger, ASME J. Comput.
  Nonlinear Dyn. 4(1), 2009). Measured by letting go beside the point of rest and looking whether the motion grows.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from trocar.protocol.bodies.haptics import MODEL_B, MODEL_COLUMNS, MODEL_CONTACT, MODEL_F0, MODEL_K
from trocar.services.gateway.servo.servo_arrays import (
    LIMIT_SIZE,
    MEMORY_FORCE,
    MEMORY_SIZE,
    NOW_DT,
    NOW_GAIN,
    NOW_SIZE,
    NOW_TTL,
)
from trocar.services.gateway.servo.servo_law import servo_force
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

#: Limits so wide that the law is linear.
_WIDE = 1e12
_TTL_S = 0.02
_LONGEST_DELAY = 256


@dataclass(frozen=True)
class VirtualWall:
    """A device and the wall that it meets.

    Attributes:
        stiffness_n_m, damping_n_s_m: Of the wall, K and B.
        mass_kg, friction_n_s_m: Of the device, m and b.
        period_s: T: how often the servo runs.
        delay: Whole periods from reading the position to applying the force that answers it.
    """

    stiffness_n_m: float
    damping_n_s_m: float = 0.0
    mass_kg: float = 0.075
    friction_n_s_m: float = 0.5
    period_s: float = 1e-3
    delay: int = 0

    @property
    def lag_s(self) -> float:
        """T/2 + t_d: what hold and delay keep the force behind."""
        return (0.5 + self.delay) * self.period_s

    def model(self) -> FloatArray:
        """Return the local model, (MODEL_COLUMNS,), of a wall at 0 on the first axis."""
        model = np.zeros(MODEL_COLUMNS)
        model[MODEL_K], model[MODEL_B], model[MODEL_CONTACT] = self.stiffness_n_m, self.damping_n_s_m, 1.0
        return model

    def limits(self) -> FloatArray:
        """Return limits, (LIMIT_SIZE,), that never act: friction that takes all bounds no energy."""
        return np.full(LIMIT_SIZE, _WIDE)

    def now(self) -> FloatArray:
        """Return a tick, (NOW_SIZE,), whose model is fresh."""
        now = np.zeros(NOW_SIZE)
        now[NOW_DT], now[NOW_TTL], now[NOW_GAIN] = self.period_s, _TTL_S, 1.0
        return now


def passive_friction(wall: VirtualWall) -> float:
    """Return the friction, N s/m, from which the wall is passive with any hand: theory."""
    return wall.stiffness_n_m * wall.lag_s + abs(wall.damping_n_s_m)


def stable_stiffness(wall: VirtualWall) -> float:
    """Return the stiffness, N/m, up to which the device is stable at the wall without a hand: theory."""
    return (wall.friction_n_s_m + wall.damping_n_s_m) / wall.lag_s


def measured_passive_friction(wall: VirtualWall, frequencies: int = 40, ticks: int = 8000) -> float:
    """Return the same as `passive_friction`, from energies: the worst of whole cycles up to half the rate."""
    cycles = np.unique(np.geomspace(4, ticks // 2, frequencies).astype(int))
    angles = 2.0 * math.pi / ticks * cycles
    model, limits, now = wall.model(), wall.limits(), wall.now()
    return max(_friction_needed(model, limits, now, wall.delay, float(angle), ticks, *_fresh()) for angle in angles)


def measured_stable_stiffness(wall: VirtualWall, tolerance: float = 0.005) -> float:
    """Return the same as `stable_stiffness`, by bisection on whether motion beside the point of rest grows."""
    low, high = 0.0, 4.0 * max(stable_stiffness(wall), 1.0)
    while high - low > tolerance * high:
        middle = (low + high) / 2.0
        if grows(replace(wall, stiffness_n_m=middle)):
            high = middle
        else:
            low = middle
    return (low + high) / 2.0


def grows(wall: VirtualWall, ticks: int = 6000) -> bool:
    """Return whether a device that is let go 1 mm beside its point of rest moves more and more."""
    path = released(wall, ticks)
    late = np.abs(path[-ticks // 4 :]).max()
    early = np.abs(path[ticks // 4 : ticks // 2]).max()
    return not math.isfinite(late) or bool(late > early)


def released(wall: VirtualWall, ticks: int) -> FloatArray:
    """Return positions in m, (ticks,), of a device that is let go 1 mm inside a wall that holds it both ways."""
    device = np.array([[0.0, 1.0], [0.0, -wall.friction_n_s_m / wall.mass_kg]])
    block = np.zeros((3, 3))
    block[:2, :2], block[1, 2] = device, 1.0 / wall.mass_kg
    step = expm(block * wall.period_s)[:2]
    path = np.zeros(ticks)
    _release(step, wall.model(), wall.limits(), wall.now(), wall.delay, *_fresh(), path)
    return path


def _fresh() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return memory of the servo, motion and forces that wait, all of nothing."""
    return np.zeros(MEMORY_SIZE), np.zeros(6), np.zeros(_LONGEST_DELAY)


@kernel
def _release(
    step: FloatArray,
    model: FloatArray,
    limits: FloatArray,
    now: FloatArray,
    delay: int,
    memory: FloatArray,
    motion: FloatArray,
    waiting: FloatArray,
    path: FloatArray,
) -> None:
    x, v, last = 1e-3, 0.0, 1e-3
    for k in range(path.size):
        motion[0], motion[3] = x, (x - last) / now[NOW_DT]
        last = x
        servo_force(model, motion, limits, now, memory)
        waiting[k % _LONGEST_DELAY] = memory[MEMORY_FORCE]
        force = waiting[(k - delay) % _LONGEST_DELAY] if k >= delay else 0.0
        x, v = (
            step[0, 0] * x + step[0, 1] * v + step[0, 2] * force,
            step[1, 0] * x + step[1, 1] * v + step[1, 2] * force,
        )
        path[k] = x
        if abs(x) > 1.0:
            path[k:] = np.inf
            return


@kernel
def _friction_needed(
    model: FloatArray,
    limits: FloatArray,
    now: FloatArray,
    delay: int,
    angle: float,
    ticks: int,
    memory: FloatArray,
    motion: FloatArray,
    waiting: FloatArray,
) -> float:
    """Return the energy that comes out of a motion of `angle` a period, over what 1 N s/m would take out of it.

    Between two readings the device moves at a constant speed: what friction takes at the least for these positions.
    """
    amplitude, period = 1e-3, now[NOW_DT]
    out, taken, settled, last = 0.0, 0.0, delay + 4, 0.0
    for k in range(ticks + settled):
        x = amplitude * math.sin(angle * k + 0.5)
        following = amplitude * math.sin(angle * (k + 1) + 0.5)
        motion[0], motion[3] = x, (x - last) / period
        last = x
        servo_force(model, motion, limits, now, memory)
        waiting[k % _LONGEST_DELAY] = memory[MEMORY_FORCE]
        if k >= settled:
            out += waiting[(k - delay) % _LONGEST_DELAY] * (following - x)
            taken += (following - x) ** 2 / period
    return out / taken


def response(wall: VirtualWall, frequency_hz: float, bus_delay: int | None = None, periods: int = 8) -> complex:
    """Return force over position, N/m, of a device that is moved in a sinusoid; both as continuous signals.

    Without `bus_delay` the servo evaluates the model against the present position. With it, a force that the wall says
    to the position of so many ticks ago is all that comes over the bus.
    """
    angle = 2.0 * math.pi * frequency_hz * wall.period_s
    ticks = round(periods / (frequency_hz * wall.period_s))
    bus = -1 if bus_delay is None else bus_delay
    memory, motion, _ = _fresh()
    found = _respond(
        wall.model(), wall.limits(), wall.now(), bus, angle, ticks, memory, motion, np.zeros(MODEL_COLUMNS)
    )
    return complex(found)


@kernel
def _respond(
    model: FloatArray,
    limits: FloatArray,
    now: FloatArray,
    bus_delay: int,
    angle: float,
    ticks: int,
    memory: FloatArray,
    motion: FloatArray,
    f0: FloatArray,
) -> complex:
    amplitude, period, settled = 1e-3, now[NOW_DT], max(bus_delay, 0) + 4
    total, last = 0.0j, 0.0
    for k in range(ticks + settled):
        x = amplitude * math.sin(angle * k)
        motion[0], motion[3] = x, (x - last) / period
        last = x
        if bus_delay < 0:
            servo_force(model, motion, limits, now, memory)
        else:
            old = amplitude * math.sin(angle * (k - bus_delay))
            older = amplitude * math.sin(angle * (k - bus_delay - 1))
            f0[MODEL_CONTACT] = 1.0
            f0[MODEL_F0] = -model[MODEL_K] * old - model[MODEL_B] * (old - older) / period
            servo_force(f0, motion, limits, now, memory)
        if k >= settled:  # the Fourier coefficient of a force that is held for the period
            held = (cmath.exp(-1j * angle * k) - cmath.exp(-1j * angle * (k + 1))) / (1j * angle)
            total -= memory[MEMORY_FORCE] * held
    return total / (ticks * amplitude / 2j)
