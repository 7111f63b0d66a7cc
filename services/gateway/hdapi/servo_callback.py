"""What the library's 1 kHz thread runs: one callback for all arms, machine code that never touches the interpreter.

Each arm gets one frame: read, drain the error stack, calibrate, evaluate the force law of the newest order at the pose
just read, apply, drain again. The gateway says what goes into the law, `servo_law.servo_force`; the library's thread
evaluates it so that the force is not a tick old (docs/decisions/hdapi-callback.md).

Beyond the law a force can only be taken back here: on any doubt (a model at the end of its life, a gateway that orders
forces and is silent for `STALE_NS`, motors not wanted, not calibrated, an error, a number that is not finite) it goes
to zero at the rig's rate limit. When there is none, it comes back as in `engagement`: once little is asked for, since a
force that appears in the middle of a contact would give energy, and over `TRUST_S`.

An arm with an error that is no mere refusal of force is let go and stays so until a person arms the rig; the others go
on. An arm that cannot be reached gets no more frames, so that nobody waits for it. An error of the scheduler itself
lets every arm go; then the callback ends.
"""

from __future__ import annotations

import functools
import math
from typing import Any

from numba import cfunc, types

from services.gateway.engagement import SMALL_FORCE_N
from services.gateway.hdapi import native
from services.gateway.hdapi.cells import (
    FORCE,
    GIMBAL,
    ORDER_AGE,
    ORDER_ARMED,
    ORDER_ENABLED,
    ORDER_FORCE,
    ORDER_GAIN,
    ORDER_LAW,
    ORDER_LIMITS,
    ORDER_MODEL,
    ORDER_TIME,
    ORDER_TTL,
    POSITION,
    SEEN_ARMED,
    SEEN_BUTTONS,
    SEEN_CALIBRATION,
    SEEN_ERROR,
    SEEN_FORCE,
    SEEN_LATE,
    SEEN_MEMORY,
    SEEN_POSITION,
    SEEN_REFUSAL,
    SEEN_REFUSED,
    SEEN_ROLL,
    SEEN_STOPPED,
    SEEN_TEMPERATURE,
    SEEN_TIME,
    SEEN_TRUST,
    SEEN_VELOCITY,
    TEMPERATURE,
    ArmCell,
    Functions,
    Servo,
    arm_at,
    servo_at,
)
from services.gateway.hdapi.constants import (
    CALLBACK_CONTINUE,
    CALLBACK_DONE,
    FIRST_LINK_ERROR,
    FIRST_REFUSAL,
    FORCE_OUTPUT,
    INVALID_PRIORITY,
    LAST_LINK_ERROR,
    LAST_REFUSAL,
    SCHEDULER_FULL,
    TIMER_ERROR,
    WARM_MOTORS,
    Calibration,
    Parameter,
    Style,
)
from services.gateway.hdapi.handover import put, take
from services.gateway.layout import (
    LIMIT_SIZE,
    MEMORY_DEMAND,
    MEMORY_FORCE,
    MEMORY_SIZE,
    MODEL_SIZE,
    NOW_AGE,
    NOW_DT,
    NOW_GAIN,
    NOW_TEMPERATURE,
    NOW_TTL,
)
from services.gateway.pose import force_to_arm, to_world
from services.gateway.servo_law import servo_force
from services.gateway.velocity_filter import low_pass
from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address

TICK_S, TICK_NS = 1e-3, 1_000_000
#: An order older than this is doubted. With 15 ms from 3 N to nothing the hand is free before a model's life of 20 ms.
STALE_NS = 4_000_000
TRUST_S = 0.1
#: A tick that comes late does not earn a larger step, as in `servo_law`.
MAX_STEP_S = 0.003
LATE_NS = 2_000_000
_CHECK_EVERY, _RECHECK_EVERY = 100, 1000
_ERRORS_A_FRAME = 32

# A kernel may read constants of its module; of an enumeration only through these.
_BUTTONS, _POSITION, _GIMBAL = int(Parameter.CURRENT_BUTTONS), int(Parameter.CURRENT_POSITION), 0x2150
_TEMPERATURE, _FORCE = int(Parameter.MOTOR_TEMPERATURE), int(Parameter.CURRENT_FORCE)
_CALIBRATED, _NEEDS_UPDATE = int(Calibration.OK), int(Calibration.NEEDS_UPDATE)
_ENCODER_RESET = int(Style.ENCODER_RESET)


@kernel
def servo_tick(address: Address[Servo]) -> int:
    """Serve every arm once; return what the scheduler is to do with the callback."""
    servo = servo_at(address)
    native.call_unsigned_pointer(servo.functions.clock_gettime, 1, servo.time_at)  # CLOCK_MONOTONIC
    now_ns = 1_000_000_000 * servo.time[0] + servo.time[1]
    servo.calls += 1
    limp = True
    for k in range(servo.arms.shape[0]):
        arm = arm_at(servo.arms[k])
        _serve(servo, arm, now_ns)
        limp = limp and not arm.motors_on
    return CALLBACK_DONE if servo.stopped_by != 0 and limp else CALLBACK_CONTINUE


@kernel
def _serve(servo: Servo, arm: ArmCell, now_ns: int) -> None:
    _take_order(arm)
    dt_ns = now_ns - arm.last_ns if arm.last_ns != 0 else TICK_NS
    arm.last_ns = now_ns
    if dt_ns > LATE_NS:
        arm.late += 1
    if not (_unreachable(arm.error) and not arm.motors_on):
        _frame(servo, arm, now_ns, min(1e-9 * dt_ns, MAX_STEP_S))
    _report(servo, arm)


@kernel
def _frame(servo: Servo, arm: ArmCell, now_ns: int, dt_s: float) -> None:
    functions = servo.functions
    native.call_unsigned(functions.make_current, arm.handle)
    native.call_unsigned(functions.begin_frame, arm.handle)
    _ask(functions, arm)
    _drain(servo, arm)
    if not arm.failed_now:
        _accept(arm, now_ns)
    _calibrate(functions, arm)
    _apply(servo, arm, now_ns, dt_s)
    native.call_unsigned(functions.end_frame, arm.handle)
    _drain(servo, arm)
    arm.refused = arm.refused + 1 if arm.refused_now else 0
    arm.refused_now = arm.failed_now = False


@kernel
def _take_order(arm: ArmCell) -> None:
    if take(arm.orders, arm.order) < 0:
        arm.order[ORDER_TIME] = 0.0
        return
    if arm.order[ORDER_ARMED] != arm.armed:
        arm.armed = arm.order[ORDER_ARMED]
        arm.confirmed = True
        arm.error = 0
        arm.refused = 0


@kernel
def _ask(functions: Functions, arm: ArmCell) -> None:
    numbers = arm.numbers_at
    native.call_unsigned_pointer(functions.get_doubles, _POSITION, numbers + 8 * POSITION)
    native.call_unsigned_pointer(functions.get_integers, _BUTTONS, arm.integers_at)
    if arm.has_gimbal:
        native.call_unsigned_pointer(functions.get_doubles, _GIMBAL, numbers + 8 * GIMBAL)
    if arm.has_temperature:
        native.call_unsigned_pointer(functions.get_doubles, _TEMPERATURE, numbers + 8 * TEMPERATURE)


@kernel
def _drain(servo: Servo, arm: ArmCell) -> None:
    """Empty the error stack. An error may belong to another arm than the one whose turn it is."""
    for _ in range(_ERRORS_A_FRAME):
        code, handle = native.take_error(servo.functions.get_error)
        if code == 0:
            return
        noted = False
        for k in range(servo.arms.shape[0]):
            other = arm_at(servo.arms[k])
            if other.handle == handle:
                _note(servo, other, code)
                noted = True
        if not noted:
            _note(servo, arm, code)


@kernel
def _note(servo: Servo, arm: ArmCell, code: int) -> None:
    if code == WARM_MOTORS:
        arm.warm = True
    elif FIRST_REFUSAL <= code <= LAST_REFUSAL:
        arm.refused_now = True
        arm.refusal = code
    elif code in (TIMER_ERROR, INVALID_PRIORITY, SCHEDULER_FULL):
        servo.stopped_by = code
    else:
        arm.failed_now = True
        if arm.error == 0:
            arm.error = code


@kernel
def _unreachable(error: int) -> bool:
    return FIRST_LINK_ERROR <= error <= LAST_LINK_ERROR


@kernel
def _accept(arm: ArmCell, now_ns: int) -> None:
    """Turn what the library said into the frame of the arm (toward the user, right, up) in m; pass over nonsense."""
    numbers, report = arm.numbers, arm.report
    x = 1e-3 * numbers[POSITION + 2] - arm.centre_m[2]
    y = 1e-3 * numbers[POSITION] - arm.centre_m[0]
    z = 1e-3 * numbers[POSITION + 1] - arm.centre_m[1]
    if not math.isfinite(x + y + z):
        return
    ticks = 0.0 if arm.read_ns == 0 else max(1.0, math.floor((now_ns - arm.read_ns) / TICK_NS + 0.5))
    for axis, now in enumerate((x, y, z)):
        raw = 0.0 if ticks == 0.0 else (now - arm.position_m[axis]) / (ticks * TICK_S)
        arm.position_m[axis] = now
        report[SEEN_POSITION + axis] = now
        report[SEEN_VELOCITY + axis] = low_pass(raw, arm.filtered, axis, arm.filter)
    arm.read_ns = now_ns
    hottest = 1.0 if arm.warm else 0.0
    arm.warm = False
    for k in range(FORCE - TEMPERATURE):
        hottest = max(hottest, numbers[TEMPERATURE + k])
    report[SEEN_TEMPERATURE] = hottest
    report[SEEN_ROLL] = -numbers[GIMBAL + 2]
    buttons = arm.integers[0]
    if buttons != 0 and report[SEEN_BUTTONS] == 0.0:
        arm.confirmed = True
    report[SEEN_BUTTONS] = buttons


@kernel
def _calibrate(functions: Functions, arm: ArmCell) -> None:
    every = _RECHECK_EVERY if arm.calibration == _CALIBRATED else _CHECK_EVERY
    if arm.frames % every == 0:
        arm.calibration = native.ask_unsigned(functions.check_calibration)
        # Encoders are zeroed where the arm is: only a person can say that it is in its reset posture.
        by_hand = arm.style == _ENCODER_RESET
        wanted = arm.calibration != _CALIBRATED if by_hand else arm.calibration == _NEEDS_UPDATE
        if wanted and (arm.confirmed or not by_hand):
            native.call_unsigned(functions.update_calibration, arm.style)
        arm.confirmed = False
    arm.frames += 1


@kernel
def _apply(servo: Servo, arm: ArmCell, now_ns: int, dt_s: float) -> None:
    order, force = arm.order, arm.force_n
    by_law = order[ORDER_LAW] != 0.0
    if by_law:
        young = _evaluate(arm, now_ns, dt_s)
    else:
        young = now_ns - order[ORDER_TIME] <= STALE_NS
        for axis in range(3):
            arm.wanted_n[axis] = order[ORDER_FORCE + axis]
        arm.memory[MEMORY_DEMAND] = _norm(arm.wanted_n)
    sound = arm.calibration == _CALIBRATED and arm.error == 0 and servo.stopped_by == 0
    wanted = sound and order[ORDER_ENABLED] != 0.0
    finite = math.isfinite(_norm(arm.wanted_n))
    refused = arm.refused_now or arm.refused > 0
    trusted = wanted and young and finite and not refused and now_ns - arm.read_ns <= STALE_NS
    if arm.trust == 0.0 and not arm.memory[MEMORY_DEMAND] < SMALL_FORCE_N:
        trusted = False
    arm.trust = min(1.0, arm.trust + dt_s / TRUST_S) if trusted else 0.0
    _approach(arm, arm.max_force_rate_n_s * dt_s)
    if by_law:
        _remember(arm)
    limp = force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0
    if wanted and not arm.motors_on:
        native.call_unsigned(servo.functions.enable, FORCE_OUTPUT)
        arm.motors_on = True
    elif limp and not wanted and arm.motors_on:
        _push(servo.functions, arm)
        native.call_unsigned(servo.functions.disable, FORCE_OUTPUT)
        arm.motors_on = False
    if arm.motors_on:
        _push(servo.functions, arm)


@kernel
def _norm(vector: FloatArray) -> float:
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])


@kernel
def _evaluate(arm: ArmCell, now_ns: int, dt_s: float) -> bool:
    """Write what the law wants at the present pose into `wanted_n`; return whether its model still lives."""
    order, now, report, motion, mount = arm.order, arm.now, arm.report, arm.motion, arm.mount
    for k in range(LIMIT_SIZE):
        arm.limits[k] = order[ORDER_LIMITS + k]
    for k in range(MODEL_SIZE):
        arm.model[k] = order[ORDER_MODEL + k]
    now[NOW_DT] = dt_s
    now[NOW_AGE] = order[ORDER_AGE] + 1e-9 * (now_ns - order[ORDER_TIME])
    now[NOW_TTL] = order[ORDER_TTL]
    now[NOW_GAIN] = order[ORDER_GAIN]
    now[NOW_TEMPERATURE] = report[SEEN_TEMPERATURE]
    to_world(report, SEEN_POSITION, mount, motion, 0)
    to_world(report, SEEN_VELOCITY, mount, motion, 3)
    for axis in range(3):
        motion[axis] += mount[2 + axis]
    servo_force(arm.model, motion, arm.limits, now, arm.memory)
    force_to_arm(arm.memory[MEMORY_FORCE : MEMORY_FORCE + 3], mount, arm.wanted_n)
    return bool(now[NOW_AGE] < now[NOW_TTL])


@kernel
def _remember(arm: ArmCell) -> None:
    """Let the law go on from the force that was applied: its rate limit and its observer count on that."""
    to_world(arm.force_n, 0, arm.mount, arm.memory, MEMORY_FORCE)


@kernel
def _approach(arm: ArmCell, step_n: float) -> None:
    """Move the applied force towards what is trusted of the wanted one, by at most `step_n`."""
    if arm.trust == 0.0:
        target = (0.0, 0.0, 0.0)
    else:
        wanted, share = arm.wanted_n, arm.trust
        norm = share * _norm(wanted)
        if norm > arm.max_force_n:
            share *= arm.max_force_n / norm
        target = (share * wanted[0], share * wanted[1], share * wanted[2])
    force = arm.force_n
    dx, dy, dz = target[0] - force[0], target[1] - force[1], target[2] - force[2]
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    if distance <= step_n:
        force[0], force[1], force[2] = target[0], target[1], target[2]
        return
    force[0] += step_n / distance * dx
    force[1] += step_n / distance * dy
    force[2] += step_n / distance * dz


@kernel
def _push(functions: Functions, arm: ArmCell) -> None:
    arm.numbers[FORCE] = arm.force_n[1]
    arm.numbers[FORCE + 1] = arm.force_n[2]
    arm.numbers[FORCE + 2] = arm.force_n[0]
    native.call_unsigned_pointer(functions.set_doubles, _FORCE, arm.numbers_at + 8 * FORCE)


@kernel
def _report(servo: Servo, arm: ArmCell) -> None:
    report = arm.report
    report[SEEN_TIME] = arm.read_ns
    report[SEEN_CALIBRATION] = arm.calibration
    report[SEEN_ERROR] = arm.error
    report[SEEN_STOPPED] = servo.stopped_by
    report[SEEN_REFUSAL] = arm.refusal
    report[SEEN_REFUSED] = arm.refused
    report[SEEN_LATE] = arm.late
    report[SEEN_ARMED] = arm.armed
    report[SEEN_TRUST] = arm.trust
    for axis in range(3):
        report[SEEN_FORCE + axis] = arm.force_n[axis] if arm.motors_on else 0.0
    for k in range(MEMORY_SIZE):
        report[SEEN_MEMORY + k] = arm.memory[k]
    put(arm.seen, report)


def _callback(address: Address[Servo]) -> int:
    return servo_tick(address)


@functools.cache
def callback() -> Any:
    """Return ``HDCallbackCode f(void *)``, compiled at the first call; its user data is the address of a `Servo`."""
    return cfunc(types.uint32(types.int64), cache=True, nopython=True, error_model="numpy")(_callback)
