"""The servo of one instrument: newest local model in, force and grasp torque out, every millisecond.

It is pure: time, pose and models are arguments. Ages count from the device sample that a model answers, by this
process' own clock, so neither a stepping wall clock nor another host's clock matters.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trocar.protocol.bodies.haptics import MODEL_COLUMNS
from trocar.services.gateway.devices.driver import NO_HANDLE, HandleLimits
from trocar.services.gateway.servo import servo_arrays, servo_law
from trocar.services.gateway.servo.engagement import Engagement, EngagementState
from trocar.services.gateway.servo.write_span import WriteSpan
from trocar.services.mechanics.arrays import FloatArray

#: Model, motion, limits, present tick, memory: see `servo_arrays`.
Law = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray], None]
#: Number of late ticks in a row, each longer than this, after which the force is removed.
OVERRUNS, OVERRUN_S = 3, 0.002
_MAX_AGE_S = 1e3  # of a model that never came: beyond any life, and finite, as kernels compute with it


@dataclass(frozen=True, slots=True)
class ServoLimits:
    """Limits of forces on the hand, the smaller of rig and device, and what the energy bound has to know.

    Attributes:
        count_m, friction_n, delay_s: Of the arm, as `ArmLimits` has them.
        handle: Of the handle.
    """

    force_n: float
    continuous_force_n: float
    force_rate_n_s: float
    torque_nm: float
    velocity_m_s: float
    count_m: float
    friction_n: float
    delay_s: float = 0.0
    handle: HandleLimits = NO_HANDLE

    def pack(self) -> FloatArray:
        """Return the limits as an array for kernels."""
        out = np.zeros(servo_arrays.LIMIT_SIZE)
        out[servo_arrays.LIMIT_FORCE] = self.force_n
        out[servo_arrays.LIMIT_CONTINUOUS_FORCE] = min(self.continuous_force_n, self.force_n)
        out[servo_arrays.LIMIT_RATE] = self.force_rate_n_s
        out[servo_arrays.LIMIT_TORQUE] = self.torque_nm
        out[servo_arrays.LIMIT_TORQUE_RATE] = torque_rate(self.torque_nm, self.force_rate_n_s, self.force_n)
        out[servo_arrays.LIMIT_ARM : servo_arrays.LIMIT_HANDLE] = self.count_m, self.friction_n, 0.0
        handle = self.handle
        out[servo_arrays.LIMIT_HANDLE :] = handle.count_rad, handle.friction_nm, handle.sudden_rad
        return out


def torque_rate(torque_nm: float, force_rate_n_s: float, force_n: float) -> float:
    """Return the rate limit of a torque, N m/s: the largest unloads in the same time as the largest force."""
    return torque_nm * force_rate_n_s / force_n


class Servo:
    """Evaluates the newest model at the current pose, with limits.

    Attributes:
        force_n: (3,) float64. Force to write, in world axes; a view that every `step` changes.
        grasp_on: bool. Whether the handle's drive is on and answers; otherwise the grasp torque falls to zero.
        arm_span, handle_span: WriteSpan. How long forces and torques have taken from reading to writing.
    """

    def __init__(self, limits: ServoLimits, ramp_s: float) -> None:
        self.limits = limits
        self.engagement = Engagement(ramp_s)
        self.age_s = _MAX_AGE_S
        self.grasp_on = False
        self.arm_span, self.handle_span = WriteSpan(), WriteSpan()
        self._limits = limits.pack()
        self._model = np.zeros(MODEL_COLUMNS)
        self._memory = np.zeros(servo_arrays.MEMORY_SIZE)
        self._now = np.zeros(servo_arrays.NOW_SIZE)
        self._now[servo_arrays.NOW_TTL] = self._ttl_s = 1.0
        self.force_n = self._memory[servo_arrays.MEMORY_FORCE : servo_arrays.MEMORY_FORCE + 3]
        self._answers_ns = 0
        self._incarnation = -1
        self._overruns = 0
        self._last_ns = 0
        self._last_grasp_ns = 0
        self._ramp_s = ramp_s
        self._grasp_gain = 0.0

    @property
    def torque_nm(self) -> float:
        """Grasp torque to write."""
        return float(self._memory[servo_arrays.MEMORY_TORQUE])

    @property
    def limp(self) -> bool:
        """Whether neither force nor torque is on."""
        return not self.force_n.any() and self.torque_nm == 0.0

    @property
    def scale(self) -> float:
        """Gain of the model's force on the hand, 0 (limp) to 1."""
        return float(self._memory[servo_arrays.MEMORY_SCALE])

    @property
    def refused(self) -> int:
        """Number of forces that were not finite."""
        return int(self._memory[servo_arrays.MEMORY_REFUSED])

    @property
    def energy_j(self) -> float:
        """Energy that the hand has put in since it was free, negative if it received more; the arm's alone."""
        return float(self._memory[servo_arrays.MEMORY_ENERGY])

    @property
    def reserved_j(self) -> float:
        """Energy that the present force may return to the hand until the next step accounts for it."""
        return float(self._memory[servo_arrays.MEMORY_RESERVED])

    @property
    def is_unknown(self) -> bool:
        """Whether a force has come later than the books cover, so that what the hand was given is not known."""
        return bool(self._memory[servo_arrays.MEMORY_UNKNOWN])

    def accept(self, model: FloatArray, ttl_s: float, answers_ns: int, incarnation: int) -> None:
        """Store a model (MODEL_COLUMNS,) that answers the device sample of `answers_ns`.

        A new incarnation causes a re-engagement.
        """
        if incarnation != self._incarnation:
            self._incarnation = incarnation
            self.engagement.let_go()
        self._answers_ns = answers_ns
        self._now[servo_arrays.NOW_TTL] = self._ttl_s = ttl_s
        self._model[:] = model

    def step(
        self,
        now_ns: int,
        motion: FloatArray,
        temperature: float,
        *,
        calibrated: bool,
        others_j: float = 0.0,
        reserved_j: float = 0.0,
        law: Law = servo_law.servo_force,
    ) -> bool:
        """Compute `force_n` for the pose read at `now_ns`; return True if motors must be switched on.

        Args:
            motion: (6,) float64. Position and velocity of the HIP in the world.
            temperature: Hottest motor, 0 ambient to 1 limit.
            calibrated: Whether the device's position is valid.
            others_j: Energy that the hands of all other instruments have put in.
            reserved_j: Sum of their `reserved_j`.
            law: Computes the force, in an arm's own thread where it has one.
        """
        now = self._now
        dt_s = max(0.0, (now_ns - self._last_ns) * 1e-9) if self._last_ns else 1e-3  # a clock may go back
        self._last_ns = now_ns
        self.age_s = self._age_s(now_ns)
        self._trip(motion, dt_s)
        ttl_s, is_known = self._ttl_s, not self.is_unknown
        begins = self.engagement.step(
            dt_s,
            fresh=is_known and self.age_s <= servo_law.hold_s(ttl_s),
            alive=is_known and self.age_s < ttl_s,
            demand_n=float(self._memory[servo_arrays.MEMORY_DEMAND]),
            calibrated=calibrated,
        )
        now[servo_arrays.NOW_DT] = dt_s
        now[servo_arrays.NOW_AGE] = self.age_s
        now[servo_arrays.NOW_GAIN] = self.engagement.gain
        now[servo_arrays.NOW_TEMPERATURE] = temperature
        now[servo_arrays.NOW_OTHERS], now[servo_arrays.NOW_RESERVED] = others_j, reserved_j
        span = self.arm_span
        now[servo_arrays.NOW_LAST_LATE_S] = self.limits.delay_s + span.newest_s
        now[servo_arrays.NOW_LATE_S] = self.limits.delay_s + span.longest_s
        now[servo_arrays.NOW_SKIPPED] = span.skipped
        law(self._model, motion, self._limits, now, self._memory)
        return begins

    def step_grasp(self, now_ns: int, handle: FloatArray) -> None:
        """Compute `torque_nm` for the handle (2,), angle and rate, read at `now_ns`, perhaps by a newer model.

        The torque of a drive that has returned is ramped up like a force that begins. A handle returns what its own
        hand has put into it: what arms put in stays with them.
        """
        now = self._now
        dt_s = max(0.0, (now_ns - self._last_grasp_ns) * 1e-9) if self._last_grasp_ns else 1e-3
        self._last_grasp_ns = now_ns
        now[servo_arrays.NOW_DT] = dt_s
        now[servo_arrays.NOW_AGE] = self._age_s(now_ns)
        rise = dt_s / self._ramp_s if self._ramp_s > 0.0 else 1.0
        self._grasp_gain = min(self._grasp_gain + rise, self.engagement.gain) if self.grasp_on else 0.0
        now[servo_arrays.NOW_GRASP_GAIN] = self._grasp_gain
        now[servo_arrays.NOW_OTHERS] = now[servo_arrays.NOW_RESERVED] = 0.0
        span = self.handle_span
        now[servo_arrays.NOW_LAST_LATE_S] = self.limits.handle.delay_s + span.newest_s
        now[servo_arrays.NOW_LATE_S] = self.limits.handle.delay_s + span.longest_s
        now[servo_arrays.NOW_SKIPPED] = span.skipped
        servo_law.servo_torque(self._model, handle, self._limits, now, self._memory)

    def reset_clock(self) -> None:
        """Treat the next step as the first, without a tick before."""
        self._last_ns = 0
        self._last_grasp_ns = 0

    def _age_s(self, now_ns: int) -> float:
        is_known = 0 < self._answers_ns <= now_ns  # the time of one from the future has gone back
        return min((now_ns - self._answers_ns) * 1e-9, _MAX_AGE_S) if is_known else _MAX_AGE_S

    def _trip(self, motion: FloatArray, dt_s: float) -> None:
        x, y, z, vx, vy, vz = motion.tolist()
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        if not math.isfinite(speed + x + y + z):
            self.engagement.fail("the device's pose is not a finite number")
            motion[:] = 0.0
        elif speed > self.limits.velocity_m_s and self.engagement.state is not EngagementState.OFF:
            self.engagement.fail(f"{speed:.2f} m/s is faster than the device's {self.limits.velocity_m_s:.2f} m/s")
        self._overruns = self._overruns + 1 if dt_s > OVERRUN_S else 0
        if self._overruns >= OVERRUNS:
            self.engagement.let_go()
