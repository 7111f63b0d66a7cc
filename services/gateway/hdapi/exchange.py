"""The gateway's side of an arm: take the newest reading, give a force. A microsecond each, and never a wait."""

from __future__ import annotations

from services.gateway.hdapi.cells import (
    ORDER_ARMED,
    ORDER_ENABLED,
    ORDER_FORCE,
    ORDER_TIME,
    SEEN_POSITION,
    SEEN_ROLL,
    SEEN_TEMPERATURE,
    SEEN_VELOCITY,
    Port,
    port_at,
)
from services.gateway.hdapi.handover import put, take
from services.gateway.layout import READ_POSITION, READ_ROLL, READ_TEMPERATURE, READ_VELOCITY
from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address


@kernel
def give(address: Address[Port], time_ns: int, enabled: bool, armed: int, force_n: FloatArray) -> None:
    """Order a force (3,) in the frame of the arm."""
    port = port_at(address)
    order = port.order
    order[ORDER_TIME] = time_ns
    order[ORDER_ENABLED] = 1.0 if enabled else 0.0
    order[ORDER_ARMED] = armed
    for axis in range(3):
        order[ORDER_FORCE + axis] = force_n[axis]
    put(port.orders, order)


@kernel
def look(address: Address[Port], has_roll: bool, reading: FloatArray) -> int:
    """Take the newest message into `newest` of the port and write `reading`, see `layout`; 1 if there was one."""
    port = port_at(address)
    newest = port.newest
    if take(port.seen, newest) <= 0:
        return 0
    for axis in range(3):
        reading[READ_POSITION + axis] = newest[SEEN_POSITION + axis]
        reading[READ_VELOCITY + axis] = newest[SEEN_VELOCITY + axis]
    reading[READ_TEMPERATURE] = newest[SEEN_TEMPERATURE]
    if has_roll:
        reading[READ_ROLL] = newest[SEEN_ROLL]
    return 1
