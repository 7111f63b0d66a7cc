"""The gateway's side of an arm: read the newest state, order a force or a law, in 1 to 2 us and without waiting."""

from __future__ import annotations

from trocar.protocol.bodies.haptics import MODEL_COLUMNS
from trocar.services.gateway.hdapi.cells import (
    ORDER_AGE,
    ORDER_ARMED,
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
    SEEN_ARMED,
    SEEN_CALIBRATION,
    SEEN_MEMORY,
    SEEN_POSITION,
    SEEN_REFUSAL,
    SEEN_REFUSED,
    SEEN_ROLL,
    SEEN_TEMPERATURE,
    SEEN_TIME,
    SEEN_TRUST,
    SEEN_VELOCITY,
    Port,
    port_at,
)
from trocar.services.gateway.hdapi.handover import put_message, take_message
from trocar.services.gateway.servo.servo_arrays import (
    LIMIT_SIZE,
    MEMORY_REFUSED,
    MEMORY_RESERVED,
    MEMORY_TORQUE,
    NOW_AGE,
    NOW_GAIN,
    NOW_OTHERS,
    NOW_RESERVED,
    NOW_TTL,
    READ_POSITION,
    READ_ROLL,
    READ_TEMPERATURE,
    READ_VELOCITY,
)
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address

NOTHING, AS_BEFORE, CHANGED = range(3)
#: Frames in which an arm may return energy before another arm of the library knows: until the gateway reads what the
#: arm tells, until that reaches the other arm, and while its force is held.
FRAMES_UNKNOWN = 3


@kernel
def give_force(address: Address[Port], time_ns: int, enabled: bool, armed: int, force_n: FloatArray) -> None:
    """Order a force (3,) in the frame of the arm."""
    port = port_at(address)
    order = port.order
    _begin_order(order, time_ns, enabled, armed)
    order[ORDER_LAW] = 0.0
    for axis in range(3):
        order[ORDER_FORCE + axis] = force_n[axis]
    put_message(port.orders, order)


@kernel
def give_law(
    address: Address[Port],
    time_ns: int,
    enabled: bool,
    armed: int,
    model: FloatArray,
    limits: FloatArray,
    now: FloatArray,
    memory: FloatArray,
) -> None:
    """Order the inputs of `servo_law.servo_force`, and write its last memory there into `memory`, except the torque."""
    port = port_at(address)
    order, newest = port.order, port.newest
    _begin_order(order, time_ns, enabled, armed)
    order[ORDER_LAW] = 1.0
    order[ORDER_AGE] = now[NOW_AGE]
    order[ORDER_TTL] = now[NOW_TTL]
    order[ORDER_GAIN] = now[NOW_GAIN]
    order[ORDER_OTHERS], order[ORDER_RESERVED] = now[NOW_OTHERS], now[NOW_RESERVED]
    for k in range(LIMIT_SIZE):
        order[ORDER_LIMITS + k] = limits[k]
    for k in range(MODEL_COLUMNS):
        order[ORDER_MODEL + k] = model[k]
    put_message(port.orders, order)
    refused = memory[MEMORY_REFUSED] + newest[SEEN_MEMORY + MEMORY_REFUSED] - port.refused
    port.refused = newest[SEEN_MEMORY + MEMORY_REFUSED]
    for k in range(MEMORY_TORQUE):
        memory[k] = newest[SEEN_MEMORY + k]
    memory[MEMORY_RESERVED] *= FRAMES_UNKNOWN
    memory[MEMORY_REFUSED] = refused  # includes refused torques, which are counted here


@kernel
def _begin_order(order: FloatArray, time_ns: int, enabled: bool, armed: int) -> None:
    order[ORDER_TIME] = time_ns
    order[ORDER_ENABLED] = 1.0 if enabled else 0.0
    order[ORDER_ARMED] = armed


@kernel
def look(address: Address[Port], has_roll: bool, reading: FloatArray) -> int:
    """Copy the newest message into `newest` of the port and write `reading`, see `servo_arrays`.

    Returns:
        int: `NOTHING`, `AS_BEFORE`, or `CHANGED` if more than the reading is new, or the reading is not.
    """
    port = port_at(address)
    if take_message(port.seen, port.arriving) <= 0:
        return NOTHING
    newest = port.newest
    heard = CHANGED if _is_news(port.arriving, newest) else AS_BEFORE
    for k in range(newest.shape[0]):
        newest[k] = port.arriving[k]
    for axis in range(3):
        reading[READ_POSITION + axis] = newest[SEEN_POSITION + axis]
        reading[READ_VELOCITY + axis] = newest[SEEN_VELOCITY + axis]
    reading[READ_TEMPERATURE] = newest[SEEN_TEMPERATURE]
    if has_roll:
        reading[READ_ROLL] = newest[SEEN_ROLL]
    return heard


@kernel
def _is_news(arriving: FloatArray, newest: FloatArray) -> bool:
    """Return whether a driver must evaluate a message, which in Python takes half of the time of a reading."""
    if arriving[SEEN_TIME] == newest[SEEN_TIME] or (arriving[SEEN_TRUST] == 0.0) != (newest[SEEN_TRUST] == 0.0):
        return True
    if arriving[SEEN_REFUSED] != 0.0 or arriving[SEEN_ARMED] != newest[SEEN_ARMED]:
        return True
    changed = 0
    for k in range(SEEN_CALIBRATION, SEEN_REFUSAL + 1):
        changed += arriving[k] != newest[k]
    return changed > 0
