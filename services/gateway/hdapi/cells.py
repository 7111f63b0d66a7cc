"""State of the scheduler's thread, one struct an arm and one for all, and its messages from and to the gateway.

An `ArmCell` belongs to that thread while the scheduler runs; the two boxes in it are shared with a `Port`, the
gateway's side. Messages are flat rows of float64; times are exact to 2 ns for half a year of uptime.
"""

from __future__ import annotations

from typing import Annotated

from trocar.protocol.bodies.haptics import MODEL_COLUMNS
from trocar.services.gateway.hdapi.handover import Box
from trocar.services.gateway.servo.servo_arrays import LIMIT_SIZE, MEMORY_SIZE, MEMORY_TORQUE, NOW_SIZE
from trocar.services.mechanics.arrays import FloatArray, IntArray, LongArray
from trocar.services.mechanics.compiled.struct import Struct, reader

# From the gateway: time of writing, whether motors may be on, how often a person has armed the rig; then a force in the
# frame of the arm or, with ORDER_LAW, the inputs of the force law (`servo_arrays`): age, life, gain, energy of the
# other instruments' hands and what is reserved for them, limits, model.
ORDER_TIME, ORDER_ENABLED, ORDER_ARMED, ORDER_LAW, ORDER_FORCE = range(5)
ORDER_AGE, ORDER_TTL, ORDER_GAIN, ORDER_OTHERS, ORDER_RESERVED, ORDER_LIMITS = range(7, 13)
ORDER_MODEL = ORDER_LIMITS + LIMIT_SIZE
ORDER_SIZE = ORDER_MODEL + MODEL_COLUMNS

# To the gateway: time of the newest reading, calibration, buttons, fatal error of the arm or the scheduler, the newest
# refusal of force and the number of frames in a row with one, late frames, the newest ORDER_ARMED, trust in orders, the
# period of frames in ns; then the reading, the applied force, the memory of the law except for the torque, and the
# longest time of late from the start of a callback to the end of this arm's frame, s.
(
    SEEN_TIME, SEEN_CALIBRATION, SEEN_BUTTONS, SEEN_ERROR, SEEN_STOPPED, SEEN_REFUSAL, SEEN_REFUSED, SEEN_LATE,
    SEEN_ARMED, SEEN_TRUST, SEEN_PERIOD, SEEN_POSITION,
) = range(12)  # fmt: skip
# Position, velocity and force have three places each, so that what follows begins at:
SEEN_VELOCITY, SEEN_TEMPERATURE, SEEN_ROLL, SEEN_FORCE, SEEN_MEMORY = 14, 17, 18, 19, 22
SEEN_SPAN = SEEN_MEMORY + MEMORY_TORQUE
SEEN_SIZE = SEEN_SPAN + 1  # places, as the last begins at SEEN_SPAN

# Offsets in `ArmCell.numbers`, which C writes: position, gimbal angles, temperatures, force.
POSITION, GIMBAL, TEMPERATURE, FORCE, NUMBERS = 0, 3, 6, 12, 15


class Functions(Struct):
    """Addresses of C functions."""

    make_current: int
    begin_frame: int
    end_frame: int
    enable: int
    disable: int
    get_integers: int
    get_doubles: int
    set_doubles: int
    get_error: int
    check_calibration: int
    update_calibration: int
    clock_gettime: int


class ArmCell(Struct):
    """One arm in the scheduler's thread."""

    orders: Box
    seen: Box
    order: Annotated[FloatArray, ORDER_SIZE]
    report: Annotated[FloatArray, SEEN_SIZE]
    numbers: Annotated[FloatArray, NUMBERS]
    integers: Annotated[IntArray, 8]
    centre_m: Annotated[FloatArray, 3]  # of the workspace, in the axes of the library
    filter: Annotated[FloatArray, 5]
    filtered: Annotated[FloatArray, 2, 3]
    position_m: Annotated[FloatArray, 3]
    force_n: Annotated[FloatArray, 3]
    wanted_n: Annotated[FloatArray, 3]
    mount: Annotated[FloatArray, 5]  # as `pose.pack_mount`
    motion: Annotated[FloatArray, 6]  # in the world
    model: Annotated[FloatArray, MODEL_COLUMNS]
    limits: Annotated[FloatArray, LIMIT_SIZE]
    now: Annotated[FloatArray, NOW_SIZE]
    memory: Annotated[FloatArray, MEMORY_SIZE]
    numbers_at: int
    integers_at: int
    handle: int
    style: int
    has_temperature: bool
    has_gimbal: bool
    max_force_n: float
    max_force_rate_n_s: float
    cut_off_hz: float
    delay_s: float  # that its interface adds to `wrote_s`
    period_ns: float  # from frame to frame, as measured
    counted_ns: int = 0  # start of counting frames for that, and their number
    counted: int = 0
    wrote_s: float = 0.0  # from the start of the callback to the end of the frame: of the last, the longest of late
    longest_s: float = 0.0
    frames: int = 0
    last_ns: int = 0
    read_ns: int = 0
    calibration: int = 0
    confirmed: bool = False
    armed: float = 0.0
    trust: float = 0.0
    motors_on: bool = False
    error: int = 0
    failed_now: bool = False
    forgotten_now: bool = False
    forgotten: int = 0
    refused_now: bool = False
    warm: bool = False
    refusal: int = 0
    refused: int = 0
    late: int = 0
    strange: int = 0  # positions out of reach of a hand, so far


class ServoCell(Struct):
    """All arms of one scheduler."""

    functions: Functions
    arms: Annotated[LongArray, "n"]  # addresses of `ArmCell`s
    time: Annotated[LongArray, 2]  # a struct timespec
    time_at: int
    stopped_by: int = 0
    pausing: bool = False  # all forces are to end, because the scheduler will be stopped
    calls: int = 0
    busy: Annotated[LongArray, 1]  # 1 while a thread serves the arms
    busy_at: int


class Port(Struct):
    """One arm in the gateway's loop."""

    orders: Box
    seen: Box
    order: Annotated[FloatArray, ORDER_SIZE]
    arriving: Annotated[FloatArray, SEEN_SIZE]
    newest: Annotated[FloatArray, SEEN_SIZE]
    refused: float = 0.0  # number of forces that were not finite, as last received


arm_at, servo_at, port_at = reader(ArmCell), reader(ServoCell), reader(Port)
