"""The callback of the library's 1 kHz thread, for all arms: machine code that never touches the interpreter.

Each arm gets one frame: read, drain the error stack, calibrate, evaluate the force law of the newest order at the pose
just read, apply, drain again. The gateway provides the inputs of the law, `servo_law.servo_force`; the library's thread
evaluates it so that the force is not a tick old (docs/decisions/hdapi-callback.md).

The applied force is the law's or less, see `applied_force`.

An arm with an error other than a refusal of force is released until a person arms the rig; the others continue. An
unreachable arm gets no more frames, which would wait for it. An arm whose handle has become invalid is not queried, as
the library would answer for the previous arm. An error of the scheduler itself releases all arms and ends the callback.
"""

from __future__ import annotations

import functools
import math
from typing import Any

from numba import types

from trocar.protocol.topics import TICK_NS
from trocar.services.gateway.devices.hand_reach import REACH_M_S
from trocar.services.gateway.hdapi import native
from trocar.services.gateway.hdapi.applied_force import apply_order, give_up
from trocar.services.gateway.hdapi.cells import (
    FORCE,
    GIMBAL,
    ORDER_ARMED,
    ORDER_TIME,
    POSITION,
    SEEN_ARMED,
    SEEN_BUTTONS,
    SEEN_CALIBRATION,
    SEEN_ERROR,
    SEEN_FORCE,
    SEEN_LATE,
    SEEN_MEMORY,
    SEEN_PERIOD,
    SEEN_POSITION,
    SEEN_REFUSAL,
    SEEN_REFUSED,
    SEEN_ROLL,
    SEEN_SPAN,
    SEEN_STOPPED,
    SEEN_TEMPERATURE,
    SEEN_TIME,
    SEEN_TRUST,
    SEEN_VELOCITY,
    TEMPERATURE,
    ArmCell,
    Functions,
    ServoCell,
    arm_at,
    servo_at,
)
from trocar.services.gateway.hdapi.constants import CALLBACK_CONTINUE, CALLBACK_DONE, Calibration, Parameter, Style
from trocar.services.gateway.hdapi.error_stack import drain, unreachable
from trocar.services.gateway.hdapi.handover import put_message, take_message
from trocar.services.gateway.servo.servo_arrays import MEMORY_TORQUE
from trocar.services.gateway.servo.servo_law import MAX_STEP_S
from trocar.services.gateway.servo.velocity_filter import design, low_pass
from trocar.services.gateway.servo.write_span import FORGOTTEN
from trocar.services.mechanics import compiled
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address

#: Periods after which a frame is late: one was lost, as the library does not catch up.
LATE_PERIODS = 2.0
#: Time over which the library's rate is measured, and the deviation up to which the nominal rate is assumed.
_COUNT_NS, _NEARLY = 250_000_000, 0.1
#: Frames in a row with an invalid handle after which there is nothing left to release, as one alone may be lost while
#: another arm of the library is opened.
_FORGOTTEN_FRAMES = 3
#: Frames between checks of the calibration: ten a second for a person who is asked to help, one while nothing is to
#: change it.
_CHECK_EVERY, _RECHECK_EVERY = 100, 1000

# Kernels can read constants of their module, but not members of an enumeration.
_BUTTONS, _POSITION, _GIMBAL = int(Parameter.CURRENT_BUTTONS), int(Parameter.CURRENT_POSITION), 0x2150
_TEMPERATURE = int(Parameter.MOTOR_TEMPERATURE)
_CALIBRATED, _NEEDS_UPDATE = int(Calibration.OK), int(Calibration.NEEDS_UPDATE)
_ENCODER_RESET = int(Style.ENCODER_RESET)


@kernel
def servo_tick(address: Address[ServoCell]) -> int:
    """Serve every arm once; return whether the scheduler is to continue the callback, as its code."""
    servo = servo_at(address)
    if not native.claim(servo.busy_at):  # a second thread of the library; an arm's memory is for one
        return CALLBACK_CONTINUE
    now_ns = _now_ns(servo)
    servo.calls += 1
    limp = True
    for k in range(servo.arms.shape[0]):
        arm = arm_at(servo.arms[k])
        _serve(servo, arm, now_ns)
        limp = limp and not arm.motors_on
    native.fence()
    servo.busy[0] = 0
    return CALLBACK_DONE if servo.stopped_by != 0 and limp else CALLBACK_CONTINUE


@kernel
def claim_cell(address: Address[ServoCell]) -> bool:
    """Return whether no thread serves the arms, and none will from now on."""
    return native.claim(servo_at(address).busy_at)


@kernel
def _now_ns(servo: ServoCell) -> int:
    native.call_unsigned_pointer(servo.functions.clock_gettime, 1, servo.time_at)  # CLOCK_MONOTONIC
    return int(1_000_000_000 * servo.time[0] + servo.time[1])


@kernel
def _serve(servo: ServoCell, arm: ArmCell, now_ns: int) -> None:
    _take_order(arm)
    dt_ns = now_ns - arm.last_ns if arm.last_ns != 0 else TICK_NS
    arm.last_ns = now_ns
    if dt_ns < 0 or dt_ns > LATE_PERIODS * arm.period_ns:
        arm.late += 1
    _measure_rate(arm, now_ns)
    if not (unreachable(arm.error) and not arm.motors_on):
        _frame(servo, arm, now_ns, min(max(1e-9 * dt_ns, 0.0), MAX_STEP_S))  # a clock may go back
    _report(servo, arm)


@kernel
def _measure_rate(arm: ArmCell, now_ns: int) -> None:
    """Measure the rate of frames, which may differ from the configured one and scales velocities."""
    passed_ns = now_ns - arm.counted_ns
    if 0 <= passed_ns < _COUNT_NS:
        arm.counted += 1
        return
    if 0 < passed_ns < 2 * _COUNT_NS:  # otherwise it was stopped, or time has gone back
        period_ns = passed_ns / (arm.counted + 1)
        if abs(period_ns - TICK_NS) < _NEARLY * TICK_NS:
            period_ns = float(TICK_NS)
        if abs(period_ns - arm.period_ns) > 0.5 * _NEARLY * arm.period_ns:
            arm.period_ns = period_ns
            design(arm.cut_off_hz, 1e-9 * period_ns, arm.filter)
    arm.counted_ns, arm.counted = now_ns, 0


@kernel
def _frame(servo: ServoCell, arm: ArmCell, now_ns: int, dt_s: float) -> None:
    functions = servo.functions
    native.call_unsigned(functions.make_current, arm.handle)
    drain(servo, arm)
    if arm.forgotten_now:  # another arm is still the current one: no further calls
        arm.forgotten += 1
        if arm.forgotten >= _FORGOTTEN_FRAMES:
            give_up(arm)
    else:
        arm.forgotten = 0
        _exchange(servo, arm, now_ns, dt_s)
    arm.refused_now = arm.failed_now = arm.forgotten_now = False


@kernel
def _exchange(servo: ServoCell, arm: ArmCell, now_ns: int, dt_s: float) -> None:
    functions = servo.functions
    native.call_unsigned(functions.begin_frame, arm.handle)
    _ask_arm(functions, arm)
    drain(servo, arm)
    if not arm.failed_now:
        _accept(arm, now_ns)
    _calibrate(functions, arm)
    apply_order(servo, arm, now_ns, dt_s)
    native.call_unsigned(functions.end_frame, arm.handle)
    arm.wrote_s = max(0.0, 1e-9 * (_now_ns(servo) - now_ns))
    arm.longest_s = max(arm.wrote_s, arm.longest_s - FORGOTTEN * dt_s)
    drain(servo, arm)
    arm.refused = arm.refused + 1 if arm.refused_now else 0


@kernel
def _take_order(arm: ArmCell) -> None:
    if take_message(arm.orders, arm.order) <= 0:  # no complete order yet
        arm.order[ORDER_TIME] = 0.0
        return
    if arm.order[ORDER_ARMED] != arm.armed:
        arm.armed = arm.order[ORDER_ARMED]
        arm.confirmed = True
        arm.error = 0
        arm.refused = 0


@kernel
def _ask_arm(functions: Functions, arm: ArmCell) -> None:
    numbers = arm.numbers_at
    native.call_unsigned_pointer(functions.get_doubles, _POSITION, numbers + 8 * POSITION)
    native.call_unsigned_pointer(functions.get_integers, _BUTTONS, arm.integers_at)
    if arm.has_gimbal:
        native.call_unsigned_pointer(functions.get_doubles, _GIMBAL, numbers + 8 * GIMBAL)
    if arm.has_temperature:
        native.call_unsigned_pointer(functions.get_doubles, _TEMPERATURE, numbers + 8 * TEMPERATURE)


@kernel
def _accept(arm: ArmCell, now_ns: int) -> None:
    """Convert the library's values to the arm's frame (toward the user, right, up) in m; ignore invalid ones."""
    numbers, report = arm.numbers, arm.report
    x = 1e-3 * numbers[POSITION + 2] - arm.centre_m[2]
    y = 1e-3 * numbers[POSITION] - arm.centre_m[0]
    z = 1e-3 * numbers[POSITION + 1] - arm.centre_m[1]
    if not math.isfinite(x + y + z) or _is_out_of_reach(arm, x, y, z, now_ns):
        return
    periods = 0.0 if arm.read_ns == 0 else max(1.0, math.floor((now_ns - arm.read_ns) / arm.period_ns + 0.5))
    for axis, now in enumerate((x, y, z)):
        raw = 0.0 if periods == 0.0 else (now - arm.position_m[axis]) / (1e-9 * periods * arm.period_ns)
        arm.position_m[axis] = now
        report[SEEN_POSITION + axis] = now
        report[SEEN_VELOCITY + axis] = low_pass(raw, arm.filtered, axis, arm.filter)
    arm.read_ns = now_ns
    hottest = 1.0 if arm.warm else 0.0
    arm.warm = False
    for k in range(FORCE - TEMPERATURE):
        if math.isfinite(numbers[TEMPERATURE + k]):
            hottest = max(hottest, numbers[TEMPERATURE + k])
    report[SEEN_TEMPERATURE] = hottest
    if math.isfinite(numbers[GIMBAL + 2]):
        report[SEEN_ROLL] = -numbers[GIMBAL + 2]
    buttons = arm.integers[0]
    if buttons != 0 and report[SEEN_BUTTONS] == 0.0:
        arm.confirmed = True
    report[SEEN_BUTTONS] = buttons


@kernel
def _is_out_of_reach(arm: ArmCell, x: float, y: float, z: float, now_ns: int) -> bool:
    """Return whether no hand moves so far since the last reading; the reading is then held, as if there were none.

    Without motors nobody feels it, and wherever the arm is, it is believed.
    """
    if arm.read_ns == 0 or not arm.motors_on:
        return False
    way_m = math.sqrt((x - arm.position_m[0]) ** 2 + (y - arm.position_m[1]) ** 2 + (z - arm.position_m[2]) ** 2)
    passed_ns = max(float(now_ns - arm.read_ns), arm.period_ns)
    is_far = way_m > REACH_M_S * 1e-9 * passed_ns
    if is_far:
        arm.strange += 1
    return is_far


@kernel
def _calibrate(functions: Functions, arm: ArmCell) -> None:
    every = _RECHECK_EVERY if arm.calibration == _CALIBRATED else _CHECK_EVERY
    if arm.frames % every == 0:
        arm.calibration = native.ask_unsigned(functions.check_calibration)
        # Encoders are zeroed at the present pose; only a person can confirm that it is the reset posture.
        by_hand = arm.style == _ENCODER_RESET
        wanted = arm.calibration != _CALIBRATED if by_hand else arm.calibration == _NEEDS_UPDATE
        if wanted and (arm.confirmed or not by_hand):
            native.call_unsigned(functions.update_calibration, arm.style)
        arm.confirmed = False
    arm.frames += 1


@kernel
def _report(servo: ServoCell, arm: ArmCell) -> None:
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
    report[SEEN_PERIOD] = arm.period_ns
    for axis in range(3):
        report[SEEN_FORCE + axis] = arm.force_n[axis] if arm.motors_on else 0.0
    for k in range(MEMORY_TORQUE):
        report[SEEN_MEMORY + k] = arm.memory[k]
    report[SEEN_SPAN] = arm.longest_s
    put_message(arm.seen, report)


def _callback(address: Address[ServoCell]) -> int:
    return servo_tick(address)


@functools.cache
def callback() -> Any:
    """Return ``HDCallbackCode f(void *)``, compiled at the first call; user data: address of a `ServoCell`."""
    return compiled.callback(types.uint32(types.int64), _callback)
