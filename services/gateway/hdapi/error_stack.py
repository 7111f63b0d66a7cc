"""The library's error stack in the scheduler's thread, emptied and evaluated in every frame."""

from __future__ import annotations

from trocar.services.gateway.hdapi import native
from trocar.services.gateway.hdapi.cells import ArmCell, ServoCell, arm_at
from trocar.services.gateway.hdapi.constants import (
    BAD_HANDLE,
    FIRST_LINK_ERROR,
    FIRST_REFUSAL,
    INVALID_PRIORITY,
    LAST_LINK_ERROR,
    LAST_REFUSAL,
    SCHEDULER_FULL,
    TIMER_ERROR,
    WARM_MOTORS,
)
from trocar.services.mechanics.compiled import kernel

#: Most errors a frame, to bound its time; the others remain for the next one.
_ERRORS_A_DRAIN = 32


@kernel
def drain(servo: ServoCell, arm: ArmCell) -> None:
    """Empty the error stack. An error may belong to another arm than the current one."""
    for _ in range(_ERRORS_A_DRAIN):
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
def _note(servo: ServoCell, arm: ArmCell, code: int) -> None:
    if code == WARM_MOTORS:
        arm.warm = True
    elif FIRST_REFUSAL <= code <= LAST_REFUSAL:
        arm.refused_now = True
        arm.refusal = code
    elif code in (TIMER_ERROR, INVALID_PRIORITY, SCHEDULER_FULL):
        servo.stopped_by = code
    else:
        arm.failed_now = True
        arm.forgotten_now = arm.forgotten_now or code == BAD_HANDLE
        if arm.error == 0:
            arm.error = code


@kernel
def unreachable(error: int) -> bool:
    """Return whether an arm with this error is unreachable."""
    return error == BAD_HANDLE or FIRST_LINK_ERROR <= error <= LAST_LINK_ERROR
