"""Hands at a wall, each a run of one kernel: an arm that is a mass with encoders and friction, and the servo's law.

A hand is a row of numbers from 0 to 1; `RANGES` says what they stand for, so that a search moves in a cube. It presses,
rests, draws back and does so again, then leaves. What the arm's viscous friction takes is left out. Readings jitter, as
those of encoders do beside the edge of a count. A force reaches the motors some time after its reading, at most that
which the servo is told, and each at another time; the arm has at least the friction that the servo is told.

A handle on a drive is such a hand on a lever: its torque is a force there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.protocol.bodies.haptics import (
    MODEL_ANGLE0,
    MODEL_B,
    MODEL_COLUMNS,
    MODEL_CONTACT,
    MODEL_F0,
    MODEL_GRASP_B,
    MODEL_GRASP_K,
    MODEL_K,
    MODEL_TORQUE,
    MODEL_X0,
)
from trocar.protocol.topics import TICK_S
from trocar.services.gateway.devices.device_files import ArmFile, GraspFile
from trocar.services.gateway.servo.servo_arrays import (
    HANDLE_ANGLE,
    HANDLE_RATE,
    HANDLE_SIZE,
    LIMIT_ARM,
    LIMIT_FORCE,
    LIMIT_HANDLE,
    LIMIT_SIZE,
    MEMORY_FORCE,
    MEMORY_SIZE,
    MEMORY_TORQUE,
    NOW_AGE,
    NOW_DT,
    NOW_GAIN,
    NOW_GRASP_GAIN,
    NOW_LAST_LATE_S,
    NOW_LATE_S,
    NOW_SIZE,
    NOW_TTL,
    OWN_COUNT,
    OWN_FRICTION,
    OWN_SIZE,
)
from trocar.services.gateway.servo.servo_law import damping_share, elastic_share, model_force, servo_force, servo_torque
from trocar.services.gateway.servo.velocity_filter import butterworth, low_pass
from trocar.services.gateway.simulated.write_delay import WRITE_SIZE, WRITES, pass_time, write_late
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import building_kernel, kernel
from trocar.studies.feel.hands import FORCE_N, RATE_N_S, TTL_S

_SUBSTEPS, LATEST = 4, 20
#: Where a finger holds a handle, and ticks from one torque to the next, as two handles take turns.
LEVER_M, HANDLE_PERIOD = 0.05, 2
#: Stiffness and damping of a finger, as shares of a hand's at an arm: up to 1,250 N/m and 5 N s/m, as Hajian and Howe
#: measured them at fingertips that press with 2 to 20 N (J. Biomechanical Engineering 119, 1997).
FINGER, FINGER_LOSS = 0.25, 0.5
LEAVING = 150
START_M, _LEAVES_M_S = 0.1e-3, 0.2


@dataclass(frozen=True)
class Range:
    """What one number of a hand means, and between which values it lies: over decades, or evenly."""

    name: str
    low: float
    high: float
    decades: bool = True


RANGES = (
    Range("wall, N/m", 30.0, 2500.0),
    Range("the wall's stiffness along itself, of that across", 0.0, 1.0, False),
    Range("stiffness of the local model, of the wall's", 0.3, 3.0),
    Range("damping of the wall, N s/m", 1e-3, 2.0),
    Range("answers late, ms", 1.0, 19.99, False),
    Range("answers lost", 0.0, 0.5, False),
    Range("hand, N/m", 50.0, 5000.0),
    Range("damping of the hand, N s/m", 0.2, 10.0),
    Range("hand while it presses, of its stiffness", 0.02, 1.0),
    Range("presses to, m", 0.05e-3, 10e-3),
    Range("presses at, m/s", 0.005, 1.0),
    Range("rests for, s", 0.5e-3, 1.0),
    Range("draws back at, m/s", 0.005, 1.2),
    Range("draws back to, m", -5e-3, 5e-3, False),
    Range("along the wall, of the way across", -2.0, 2.0, False),
    Range("place of the wall, counts", 0.0, 1.0, False),
    Range("jitter of readings, counts", 0.0, 1.0, False),
    Range("leaves after, s", 0.3, 10.0),
    Range("forces late, of what is told", 0.0, 1.0, False),
    Range("jitter of that, of it", 0.0, 1.0, False),
    Range("friction, between the least and the vendor's", 0.0, 1.0, False),
    Range("mass, of the device's with a hand", 0.7, 3.0),
    Range("grip, N", 3.0, 20.0),
)
(
    WALL, TANGENTIAL, MODEL, DAMPING, LATE, LOST, HAND, HAND_LOSS, SOFT, DEPTH, PRESS, REST, DRAW, OUT, ALONG, PLACE,
    JITTER, STAY, WRITE, WRITE_JITTER, FRICTION, MASS, GRIP,
) = range(len(RANGES))  # fmt: skip
_LOW, _HIGH = np.array([each.low for each in RANGES]), np.array([each.high for each in RANGES])
_DECADES = np.array([each.decades for each in RANGES])

# What comes of a hand: the most that it had got out at a moment at which no force was on; the same once it has left;
# what the servo alone had given then; all that went to and fro; the largest force. Then sums over the ticks at the
# wall, N: its force, and how far from it the force of the law is, and that of the local model alone.
GAINED, LEFT_WITH, SERVO, MOVED, LARGEST, WALL_FORCE, LAW_APART, MODEL_APART, BOOK_SIZE = range(9)


def decode(shares: FloatArray) -> FloatArray:
    """Return what hands (..., n) of numbers from 0 to 1 stand for, in the units of `RANGES`."""
    even = _LOW + shares * (_HIGH - _LOW)
    return np.where(_DECADES, np.where(_DECADES, _LOW, 1.0) * (_HIGH / np.where(_DECADES, _LOW, 1.0)) ** shares, even)


@dataclass(frozen=True)
class ArmAtWall:
    """An arm of a device file, as a mass; or a handle, as a mass on a lever.

    Attributes:
        told: What the servo is told: the limits of its law.
        device: What is so: see `_DEVICE`.
    """

    told: FloatArray
    now: FloatArray
    coefficients: FloatArray
    device: FloatArray

    @property
    def mass_kg(self) -> float:
        """Apparent mass at the tip."""
        return float(self.device[OWN_MASS])


# A device: mass, kg; the vendor's friction, N, and the least of it, as a share; the longest that a force takes, s; a
# handle's lever, m, 0 for an arm; ticks from one force to the next; the encoder's count, m.
OWN_MASS, DRY, LEAST, LATEST_WRITE, LEVER, PERIOD, COUNT, DEVICE_SIZE = range(8)


def arm_at_wall(
    file: ArmFile | GraspFile,
    mass_kg: float,
    *,
    bounded: bool = True,
    late_s: float | None = None,
    least: float | None = None,
) -> ArmAtWall:
    """Return what a run needs of a device.

    Args:
        file: Of a handle, the mass is that on its lever.
        bounded: If not, the law takes its friction for endless.
        late_s: Longest time that a force takes; none: that which the servo is told.
        least: Least friction that it has, as a share of the vendor's; none: that which the servo is told.
    """
    limits, now, device = np.zeros(LIMIT_SIZE), np.zeros(NOW_SIZE), np.zeros(DEVICE_SIZE)
    lever_m, period = (LEVER_M, HANDLE_PERIOD) if isinstance(file, GraspFile) else (0.0, 1)
    limits[:LIMIT_ARM] = (FORCE_N, FORCE_N, RATE_N_S, FORCE_N * LEVER_M, RATE_N_S * LEVER_M)
    own = np.array(file.own())
    place = LIMIT_HANDLE if isinstance(file, GraspFile) else LIMIT_ARM
    limits[place : place + OWN_SIZE] = own
    if not bounded:
        limits[place + OWN_FRICTION] = math.inf
    now[NOW_DT], now[NOW_TTL], now[NOW_GAIN], now[NOW_GRASP_GAIN] = period * TICK_S, TTL_S, 1.0, 1.0
    now[NOW_LAST_LATE_S] = now[NOW_LATE_S] = file.interface_delay_s
    scale = 1.0 / lever_m if lever_m else 1.0
    dry_n = scale * (file.friction_nm if isinstance(file, GraspFile) else file.friction_n)
    least = file.sure_friction if least is None else least
    late_s = file.interface_delay_s if late_s is None else late_s
    device[:] = (mass_kg, dry_n, least, late_s, lever_m, period, own[OWN_COUNT] / scale)
    filter_hz = 100.0 if isinstance(file, GraspFile) else file.velocity_filter_hz
    return ArmAtWall(limits, now, butterworth(filter_hz), device)


def books_of(hands: FloatArray, arm: ArmAtWall) -> FloatArray:
    """Return what comes of hands (n, len(RANGES)) in the units of `RANGES`: (n, BOOK_SIZE), in J and N."""
    books = np.zeros((len(hands), BOOK_SIZE))
    _run_all(np.ascontiguousarray(hands), arm.told, arm.now.copy(), arm.coefficients, arm.device, books)
    return books


@building_kernel
def _run_all(
    hands: FloatArray,
    limits: FloatArray,
    now: FloatArray,
    coefficients: FloatArray,
    device: FloatArray,
    books: FloatArray,
) -> None:
    models = np.zeros((LATEST, MODEL_COLUMNS))
    model, motion, memory = np.zeros(MODEL_COLUMNS), np.zeros(6), np.zeros(MEMORY_SIZE)
    filtered, target, state, read = np.zeros((2, 3)), np.zeros(8), np.zeros(4), np.zeros(2)
    writes, handle, force = np.zeros((WRITES, WRITE_SIZE)), np.zeros(HANDLE_SIZE), np.zeros(3)
    for k in range(hands.shape[0]):
        models[:], model[:], motion[:], memory[:] = 0.0, 0.0, 0.0, 0.0
        filtered[:], target[:], state[:], read[:], writes[:] = 0.0, 0.0, 0.0, 0.0, 0.0
        of_law = limits, now, coefficients, device
        work = models, model, motion, memory, filtered, target, state, read, writes, handle, force
        _run(hands[k], *of_law, *work, books[k])


@kernel
def _run(
    hand: FloatArray,
    limits: FloatArray,
    now: FloatArray,
    coefficients: FloatArray,
    device: FloatArray,
    models: FloatArray,
    model: FloatArray,
    motion: FloatArray,
    memory: FloatArray,
    filtered: FloatArray,
    target: FloatArray,
    state: FloatArray,
    read: FloatArray,
    writes: FloatArray,
    handle: FloatArray,
    acting: FloatArray,
    book: FloatArray,
) -> None:
    place, friction_n = hand[PLACE] * device[COUNT], _friction(hand, device)
    lever_m, period = device[LEVER], int(device[PERIOD])
    state[0] = target[0] = START_M
    given = lost = fx = fy = 0.0
    age, anchor, touched, felt = 1000, 0.0, False, False
    book[GAINED] = -1.0
    for k in range(int(hand[STAY] / TICK_S) + LEAVING):
        _read(hand, device[COUNT], place, state, k, coefficients, filtered, read, motion)
        touches = motion[0] < 0.0
        if touches and not touched:
            anchor = motion[1]
        touched = touches
        _answer(hand, motion, anchor, models[k % LATEST])
        age = take_answer(hand, models, k, k, age, model)
        now[NOW_AGE] = min(age, 1000) * TICK_S
        if k % period == 0:
            fx, fy = _write(hand, device, model, motion, limits, now, memory, handle, k, writes)
        force = math.sqrt(fx * fx + fy * fy)
        book[LARGEST] = max(book[LARGEST], force)
        _compare(hand, state, anchor, model, motion, now, fx, fy, limits[LIMIT_FORCE], book)
        felt = felt or force > 0.0
        if felt and is_limp(writes):
            book[GAINED] = max(book[GAINED], given - lost)
        stiffness, loss = move_target(hand, target, k), hand[HAND_LOSS]
        if lever_m > 0.0:
            stiffness, loss = FINGER * stiffness, FINGER_LOSS * loss
        for _ in range(_SUBSTEPS):
            pass_time(writes, TICK_S / _SUBSTEPS, acting)
            gave, rubbed = _move(hand, device, stiffness, loss, friction_n, target, acting, state)
            given += gave
            lost += rubbed
            book[MOVED] += abs(gave)
    book[LEFT_WITH], book[SERVO] = given - lost, given
    book[GAINED] = max(book[GAINED], given - lost)


@kernel
def _friction(hand: FloatArray, device: FloatArray) -> float:
    """Return the friction that a device has in this hand, N."""
    return float(device[DRY] * (device[LEAST] + hand[FRICTION] * (1.0 - device[LEAST])))


@kernel
def _read(
    hand: FloatArray,
    count_m: float,
    place: float,
    state: FloatArray,
    k: int,
    coefficients: FloatArray,
    filtered: FloatArray,
    read: FloatArray,
    motion: FloatArray,
) -> None:
    """Write what encoders see of a mass and the filtered rate of that into `motion`."""
    for axis in range(2):
        shaken = state[axis] + place + hand[JITTER] * count_m * drawn(3 * k + axis)
        seen = math.floor(shaken / count_m) * count_m - place
        motion[3 + axis] = low_pass((seen - read[axis]) / TICK_S, filtered, axis, coefficients)
        motion[axis] = read[axis] = seen


@kernel
def _answer(hand: FloatArray, motion: FloatArray, anchor: float, answer: FloatArray) -> None:
    """Write the local model of the wall for what was seen; it sticks at `anchor`."""
    answer[:] = 0.0
    if motion[0] >= 0.0:
        return
    answer[MODEL_CONTACT] = 1.0
    answer[MODEL_F0] = -hand[WALL] * motion[0]
    answer[MODEL_F0 + 1] = -hand[WALL] * hand[TANGENTIAL] * (motion[1] - anchor)
    answer[MODEL_K] = hand[MODEL] * hand[WALL]
    answer[MODEL_K + 4] = hand[MODEL] * hand[WALL] * hand[TANGENTIAL]
    answer[MODEL_B] = answer[MODEL_B + 4] = hand[DAMPING]
    answer[MODEL_X0], answer[MODEL_X0 + 1] = motion[0], motion[1]


@kernel
def take_answer(hand: FloatArray, models: FloatArray, k: int, draw: int, age: int, model: FloatArray) -> int:
    """Copy the answer that arrives in tick `k` into `model`, unless it is lost; return the model's age in ticks."""
    late = int(hand[LATE])
    if k >= late and drawn(draw) >= hand[LOST]:
        model[:] = models[(k - late) % LATEST]
        return late
    return age + 1


@kernel
def _write(
    hand: FloatArray,
    device: FloatArray,
    model: FloatArray,
    motion: FloatArray,
    limits: FloatArray,
    now: FloatArray,
    memory: FloatArray,
    handle: FloatArray,
    k: int,
    writes: FloatArray,
) -> tuple[float, float]:
    """Put the law's force for this motion under way, and return it."""
    fy, lever_m = 0.0, device[LEVER]
    if lever_m > 0.0:
        fx = _torque(lever_m, model, motion, limits, now, memory, handle) / lever_m
    else:
        servo_force(model, motion, limits, now, memory)
        fx, fy = memory[MEMORY_FORCE], memory[MEMORY_FORCE + 1]
    wait_s = device[LATEST_WRITE] * hand[WRITE] * (1.0 - hand[WRITE_JITTER] * drawn(5 * k + 2))
    write_late(writes, fx, fy, 0.0, wait_s)
    return fx, fy


@kernel
def _move(
    hand: FloatArray,
    device: FloatArray,
    stiffness: float,
    loss: float,
    friction_n: float,
    target: FloatArray,
    acting: FloatArray,
    state: FloatArray,
) -> tuple[float, float]:
    """Move the mass by a part of a tick; return what the force under way gave it, and what friction took, J."""
    mass_kg, dt = device[OWN_MASS] * hand[MASS], TICK_S / _SUBSTEPS
    hx = stiffness * (target[0] - state[0]) + loss * (target[2] - state[2])
    hy = stiffness * (target[1] - state[1]) + loss * (target[3] - state[3])
    if device[LEVER] > 0.0:
        hy = -mass_kg / dt * state[3]  # a handle has one axis
    pull = math.sqrt(hx * hx + hy * hy)
    if pull > hand[GRIP]:
        hx, hy = hx * hand[GRIP] / pull, hy * hand[GRIP] / pull
    vx, vy = state[2] + dt / mass_kg * (acting[0] + hx), state[3] + dt / mass_kg * (acting[1] + hy)
    speed = math.sqrt(vx * vx + vy * vy)
    left = max(0.0, speed - dt / mass_kg * friction_n)
    if speed > 0.0:
        vx, vy = vx * left / speed, vy * left / speed
    state[2], state[3] = vx, vy
    for axis in range(2):
        state[axis] += dt * state[2 + axis]
        target[axis] += dt * target[2 + axis]
    return dt * (acting[0] * vx + acting[1] * vy), mass_kg * (speed - left) * left


@kernel
def _torque(
    lever_m: float,
    model: FloatArray,
    motion: FloatArray,
    limits: FloatArray,
    now: FloatArray,
    memory: FloatArray,
    handle: FloatArray,
) -> float:
    """Return the servo's torque for a motion at the end of a lever, and a model of the force there."""
    model[MODEL_TORQUE], model[MODEL_ANGLE0] = lever_m * model[MODEL_F0], model[MODEL_X0] / lever_m
    model[MODEL_GRASP_K], model[MODEL_GRASP_B] = lever_m**2 * model[MODEL_K], lever_m**2 * model[MODEL_B]
    handle[HANDLE_ANGLE], handle[HANDLE_RATE] = motion[0] / lever_m, motion[3] / lever_m
    servo_torque(model, handle, limits, now, memory)
    return float(memory[MEMORY_TORQUE])


@kernel
def is_limp(writes: FloatArray) -> bool:
    """Return whether no force acts or is under way."""
    acting = 0
    for row in range(WRITES):
        acting += writes[row, 0] != 0.0 or writes[row, 1] != 0.0 or writes[row, 2] != 0.0
    return acting == 0


@kernel
def _compare(
    hand: FloatArray,
    state: FloatArray,
    anchor: float,
    model: FloatArray,
    motion: FloatArray,
    now: FloatArray,
    fx: float,
    fy: float,
    most_n: float,
    book: FloatArray,
) -> None:
    """Note how far what is felt is from the wall itself, with its shear and damping, where the hand truly is."""
    if state[0] >= 0.0:
        return
    elastic, damping = elastic_share(now[NOW_AGE], now[NOW_TTL]), damping_share(now[NOW_AGE], now[NOW_TTL])
    wall, law, alone = 0.0, 0.0, 0.0
    for axis in range(2):
        stiffness = hand[WALL] * (1.0 if axis == 0 else hand[TANGENTIAL])
        asked = -stiffness * (state[axis] - (0.0 if axis == 0 else anchor)) - hand[DAMPING] * state[2 + axis]
        wall += asked * asked
        law += ((fx if axis == 0 else fy) - asked) ** 2
        alone += (model_force(model, motion, axis, elastic, damping) - asked) ** 2
    if wall <= most_n * most_n:
        book[WALL_FORCE] += math.sqrt(wall)
        book[LAW_APART] += math.sqrt(law)
        book[MODEL_APART] += math.sqrt(alone)


@kernel
def drawn(k: int) -> float:
    """Return a number from 0 to 1 that looks like a draw, for tick `k`."""
    return (k * 2654435761 % 4294967296) / 4294967296.0


@kernel
def move_target(hand: FloatArray, target: FloatArray, k: int) -> float:
    """Set how fast the point goes to which the hand pulls: phases in [4], time of rest in [5]; return its stiffness."""
    if k * TICK_S >= hand[STAY]:
        target[2], target[3] = _LEAVES_M_S, 0.0
        return 200.0
    phase = target[4]
    if phase == 0.0 and target[0] <= -hand[DEPTH]:
        phase = 1.0
    elif phase == 2.0 and target[0] >= max(hand[OUT], -0.9 * hand[DEPTH]):
        phase = 3.0
    if phase == 1.0 or phase == 3.0:
        target[5] += TICK_S
        if target[5] > hand[REST]:
            target[5] = 0.0
            phase = 2.0 if phase == 1.0 else 0.0
    target[4] = phase
    speed = -hand[PRESS] if phase == 0.0 else hand[DRAW] if phase == 2.0 else 0.0
    target[2], target[3] = speed, speed * hand[ALONG]
    return float(hand[HAND] * (hand[SOFT] if phase == 0.0 else 1.0))
