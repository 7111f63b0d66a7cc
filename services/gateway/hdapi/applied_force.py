"""The force applied by the scheduler's thread: that of the law, or of the gateway, as far as it can be trusted.

A force can only be reduced here. On any doubt (an expired model, a gateway that orders forces and is silent for
`STALE_NS`, motors not enabled, no calibration, an error, a number that is not finite) it falls to zero at the rig's
rate limit. From zero it returns as in `engagement`: once the demand is small, because a force that appears in the
middle of a contact would add energy, and over `TRUST_S`.
"""

from __future__ import annotations

import math

from trocar.protocol.bodies.haptics import MODEL_COLUMNS
from trocar.services.gateway.hdapi import native
from trocar.services.gateway.hdapi.cells import (
    FORCE,
    ORDER_AGE,
    ORDER_ENABLED,
    ORDER_FORCE,
    ORDER_GAIN,
    ORDER_LAW,
    ORDER_LIMITS,
    ORDER_MODEL,
    ORDER_OTHERS,
    ORDER_RESERVED,
    ORDER_TIME,
    ORDER_TTL,
    SEEN_POSITION,
    SEEN_TEMPERATURE,
    SEEN_VELOCITY,
    ArmCell,
    Functions,
    ServoCell,
)
from trocar.services.gateway.hdapi.constants import FORCE_OUTPUT, Calibration, Parameter
from trocar.services.gateway.servo.engagement import SETTLE_S, SMALL_FORCE_N
from trocar.services.gateway.servo.pose import force_to_arm, to_world
from trocar.services.gateway.servo.servo_arrays import (
    LIMIT_SIZE,
    MEMORY_DEMAND,
    MEMORY_FORCE,
    NOW_AGE,
    NOW_DT,
    NOW_GAIN,
    NOW_LAST_LATE_S,
    NOW_LATE_S,
    NOW_OTHERS,
    NOW_RESERVED,
    NOW_TEMPERATURE,
    NOW_TTL,
)
from trocar.services.gateway.servo.servo_law import servo_force
from trocar.services.gateway.servo.slew import slew_vector
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

#: An ordered force, or a pose, older than this is not trusted, nor one from as far in the future: a clock may go back.
#: As a force of 3 N then falls to zero in 15 ms, the hand is free before a model's life of 20 ms.
STALE_NS = 4_000_000
TRUST_S = SETTLE_S
_FORCE, _CALIBRATED = int(Parameter.CURRENT_FORCE), int(Calibration.OK)


@kernel
def apply_order(servo: ServoCell, arm: ArmCell, now_ns: int, dt_s: float) -> None:
    """Apply the newest order within a frame, and switch the motors accordingly, off only without force."""
    young = _want(arm, now_ns, dt_s)
    sound = arm.calibration == _CALIBRATED and arm.error == 0 and servo.stopped_by == 0 and not servo.pausing
    motors = sound and arm.order[ORDER_ENABLED] != 0.0
    trusted = motors and young and _is_believable(arm, now_ns)
    arm.trust = min(1.0, arm.trust + dt_s / TRUST_S) if trusted else 0.0
    if trusted and arm.order[ORDER_LAW] != 0.0:
        _fall(arm)
    _approach(arm, arm.max_force_rate_n_s * dt_s)
    _remember(arm)
    _push(servo.functions, arm, motors)


@kernel
def give_up(arm: ArmCell) -> None:
    """Reset the state of a lost arm: no force, motors off."""
    for axis in range(3):
        arm.force_n[axis] = 0.0
    arm.trust = 0.0
    arm.motors_on = False
    _remember(arm)


@kernel
def _want(arm: ArmCell, now_ns: int, dt_s: float) -> bool:
    """Write the desired force and the demand; return whether the order is young enough."""
    if arm.order[ORDER_LAW] != 0.0:
        return _evaluate(arm, now_ns, dt_s)
    for axis in range(3):
        arm.wanted_n[axis] = arm.order[ORDER_FORCE + axis]
    arm.memory[MEMORY_DEMAND] = _norm(arm.wanted_n)
    return bool(abs(now_ns - arm.order[ORDER_TIME]) <= STALE_NS)


@kernel
def _is_believable(arm: ArmCell, now_ns: int) -> bool:
    refused = arm.refused_now or arm.refused > 0
    may_begin = arm.trust > 0.0 or arm.memory[MEMORY_DEMAND] < SMALL_FORCE_N
    return not refused and may_begin and math.isfinite(_norm(arm.wanted_n)) and abs(now_ns - arm.read_ns) <= STALE_NS


@kernel
def _norm(vector: FloatArray) -> float:
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])


@kernel
def _evaluate(arm: ArmCell, now_ns: int, dt_s: float) -> bool:
    """Write the law's force at the present pose into `wanted_n`; return whether its model has not expired."""
    order, now, report, motion, mount = arm.order, arm.now, arm.report, arm.motion, arm.mount
    for k in range(LIMIT_SIZE):
        arm.limits[k] = order[ORDER_LIMITS + k]
    for k in range(MODEL_COLUMNS):
        arm.model[k] = order[ORDER_MODEL + k]
    now[NOW_DT] = dt_s
    now[NOW_AGE] = order[ORDER_AGE] + 1e-9 * (now_ns - order[ORDER_TIME])
    now[NOW_TTL] = order[ORDER_TTL]
    now[NOW_GAIN] = order[ORDER_GAIN]
    now[NOW_OTHERS], now[NOW_RESERVED] = order[ORDER_OTHERS], order[ORDER_RESERVED]
    now[NOW_TEMPERATURE] = report[SEEN_TEMPERATURE]
    now[NOW_LAST_LATE_S], now[NOW_LATE_S] = arm.delay_s + arm.wrote_s, arm.delay_s + arm.longest_s
    to_world(report, SEEN_POSITION, mount, motion, 0)
    to_world(report, SEEN_VELOCITY, mount, motion, 3)
    for axis in range(3):
        motion[axis] += mount[2 + axis]
    servo_force(arm.model, motion, arm.limits, now, arm.memory)
    force_to_arm(arm.memory[MEMORY_FORCE : MEMORY_FORCE + 3], mount, arm.wanted_n)
    return bool(-1e-9 * STALE_NS <= now[NOW_AGE] < now[NOW_TTL])


@kernel
def _remember(arm: ArmCell) -> None:
    """Set the law's last force to the applied one, on which its rate limit and energy observer rely."""
    to_world(arm.force_n, 0, arm.mount, arm.memory, MEMORY_FORCE)


@kernel
def _fall(arm: ArmCell) -> None:
    """Take the law's force if it is smaller: it may fall as fast as the hand withdraws, even in a ramp."""
    if _norm(arm.wanted_n) < _norm(arm.force_n):
        for axis in range(3):
            arm.force_n[axis] = arm.wanted_n[axis]


@kernel
def _approach(arm: ArmCell, step_n: float) -> None:
    """Move the applied force towards the trusted part of the desired one, by at most `step_n`."""
    if arm.trust == 0.0:
        target = (0.0, 0.0, 0.0)
    else:
        wanted, share = arm.wanted_n, arm.trust
        norm = share * _norm(wanted)
        if norm > arm.max_force_n:
            share *= arm.max_force_n / norm
        target = (share * wanted[0], share * wanted[1], share * wanted[2])
    force = arm.force_n
    force[0], force[1], force[2] = slew_vector((force[0], force[1], force[2]), target, step_n)


@kernel
def _push(functions: Functions, arm: ArmCell, motors: bool) -> None:
    if not math.isfinite(_norm(arm.force_n)):
        arm.force_n[0] = arm.force_n[1] = arm.force_n[2] = 0.0
    limp = arm.force_n[0] == 0.0 and arm.force_n[1] == 0.0 and arm.force_n[2] == 0.0
    if motors and not arm.motors_on:
        native.call_unsigned(functions.enable, FORCE_OUTPUT)
        arm.motors_on = True
    if not arm.motors_on:
        return
    arm.numbers[FORCE] = arm.force_n[1]
    arm.numbers[FORCE + 1] = arm.force_n[2]
    arm.numbers[FORCE + 2] = arm.force_n[0]
    native.call_unsigned_pointer(functions.set_doubles, _FORCE, arm.numbers_at + 8 * FORCE)
    if limp and not motors:
        native.call_unsigned(functions.disable, FORCE_OUTPUT)
        arm.motors_on = False
