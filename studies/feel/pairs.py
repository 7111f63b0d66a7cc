"""Two hands at one piece of tissue, each with a linked Premium: what one puts in, the other may get.

A pair is two rows of `wall_hands.RANGES` and a coupling. Each hand has its side of the tissue, which is held to the
ground, and stuff between the sides that either presses against the other:
f_i = K_i max(0, d_i) + C max(0, d_1 + d_2) at the depths d. So quasi-static tissue makes no energy of its own.
"""

from __future__ import annotations

import math

import numpy as np

from trocar.protocol.bodies.haptics import MODEL_B, MODEL_COLUMNS, MODEL_CONTACT, MODEL_F0, MODEL_K, MODEL_X0
from trocar.protocol.topics import TICK_S
from trocar.services.gateway.devices.device_files import SURE_FRICTION
from trocar.services.gateway.servo.servo_arrays import (
    MEMORY_ENERGY,
    MEMORY_FORCE,
    MEMORY_RESERVED,
    MEMORY_SIZE,
    NOW_AGE,
    NOW_OTHERS,
    NOW_RESERVED,
    READ_POSITION,
    READ_SIZE,
    READ_VELOCITY,
)
from trocar.services.gateway.servo.servo_law import servo_force
from trocar.services.gateway.servo.velocity_filter import butterworth
from trocar.services.gateway.simulated import premium_model, simulated_arm
from trocar.services.gateway.simulated.premium_model import GEARS
from trocar.services.gateway.simulated.simulated_arm import (
    COUNTS,
    HAND_DAMPING,
    HAND_GRIP,
    HAND_RATE,
    HAND_SIZE,
    HAND_STIFFNESS,
    HAND_TARGET,
    filter_reading,
    measure,
    step_links,
)
from trocar.services.gateway.simulated.write_delay import WRITE_SIZE, WRITES
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import building_kernel, kernel
from trocar.studies.feel.hands import WRITE_S, servo_settings
from trocar.studies.feel.wall_hands import (
    BOOK_SIZE,
    DAMPING,
    FRICTION,
    GAINED,
    GRIP,
    HAND_LOSS,
    JITTER,
    LARGEST,
    LATEST,
    LEAVING,
    LEFT_WITH,
    MODEL,
    MOVED,
    RANGES,
    SERVO,
    START_M,
    STAY,
    WALL,
    WRITE,
    WRITE_JITTER,
    decode,
    drawn,
    is_limp,
    move_target,
    take_answer,
)

#: A pair in the cube of a search: two hands, and the stuff between, of the softer side's stiffness.
DIMENSIONS = 2 * len(RANGES) + 1
_FILTER_HZ = 100.0


def books_of_pairs(shares: FloatArray, *, bounded: bool = True) -> FloatArray:
    """Return what comes of pairs (n, DIMENSIONS) of numbers from 0 to 1: (n, BOOK_SIZE), both hands together."""
    books = np.zeros((len(shares), BOOK_SIZE))
    hands = decode(shares[:, :-1].reshape(len(shares), 2, len(RANGES)))
    limits, now = servo_settings(bounded=bounded)
    start, centre = np.array(premium_model.CENTRE_ANGLES), premium_model.centre()
    _run_all(hands, 2.0 * shares[:, -1], limits, now, start, centre, butterworth(_FILTER_HZ), books)
    return books


@building_kernel
def _run_all(
    hands: FloatArray,
    couplings: FloatArray,
    limits: FloatArray,
    now: FloatArray,
    start: FloatArray,
    centre: FloatArray,
    coefficients: FloatArray,
    books: FloatArray,
) -> None:
    for k in range(hands.shape[0]):
        between = couplings[k] * min(hands[k, 0, WALL], hands[k, 1, WALL])
        _run(hands[k], between, limits, now, start, centre, coefficients, books[k])


@kernel
def _run(
    hands: FloatArray,
    between: float,
    limits: FloatArray,
    now: FloatArray,
    start: FloatArray,
    centre: FloatArray,
    coefficients: FloatArray,
    book: FloatArray,
) -> None:
    models, model = np.zeros((2, LATEST, MODEL_COLUMNS)), np.zeros((2, MODEL_COLUMNS))
    motion, memory, reading = np.zeros((2, 6)), np.zeros((2, MEMORY_SIZE)), np.zeros(READ_SIZE)
    angles, rates, heat = np.zeros((2, 3)), np.zeros((2, 3)), np.full((2, 2, 3), simulated_arm.ROOM_C)
    filtered, measured, target = np.zeros((2, 2, 3)), np.zeros((2, 3)), np.zeros((2, 8))
    hand, work, jacobian, force = np.zeros(HAND_SIZE), np.zeros((4, 3)), np.zeros((3, 3)), np.zeros(3)
    age, shaken = np.full(2, 1000), np.zeros(3)
    for i in range(2):
        angles[i], target[i, 0] = start, START_M
        measure(angles[i], measured[i])
    given = lost = 0.0
    writes, work_of, felt = np.zeros((2, WRITES, WRITE_SIZE)), np.zeros(1), False
    book[GAINED] = -1.0
    for k in range(int(max(hands[0, STAY], hands[1, STAY]) / TICK_S) + LEAVING):
        for i in range(2):
            _shake(hands[i], angles[i], 6 * k + 3 * i, shaken)
            filter_reading(shaken, measured[i], filtered[i], coefficients, centre, reading)
            motion[i, :3] = reading[READ_POSITION : READ_POSITION + 3]
            motion[i, 3:] = reading[READ_VELOCITY : READ_VELOCITY + 3]
        pressed = 0.0
        for i in range(2):
            _answer(hands[i], between, motion[i], motion[1 - i, 2], models[i, k % LATEST])
            age[i] = take_answer(hands[i], models[i], k, 2 * k + i, age[i], model[i])
            now[NOW_AGE] = min(age[i], 1000) * TICK_S
            now[NOW_OTHERS], now[NOW_RESERVED] = memory[1 - i, MEMORY_ENERGY], memory[1 - i, MEMORY_RESERVED]
            servo_force(model[i], motion[i], limits, now, memory[i])
            force[:] = memory[i, MEMORY_FORCE : MEMORY_FORCE + 3]
            pressed = max(pressed, math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2))
        book[LARGEST] = max(book[LARGEST], pressed)
        felt = felt or pressed > 0.0
        if felt and pressed == 0.0 and is_limp(writes[0]) and is_limp(writes[1]):
            book[GAINED] = max(book[GAINED], given - lost)
        for i in range(2):
            force[:] = memory[i, MEMORY_FORCE : MEMORY_FORCE + 3]
            _lead_hand(hands[i], centre, k, target[i], hand)
            friction = SURE_FRICTION + hands[i, FRICTION] * (1.0 - SURE_FRICTION)
            wait_s = WRITE_S * hands[i, WRITE] * (1.0 - hands[i, WRITE_JITTER] * drawn(10 * k + 5 * i + 2))
            before, gave = (angles[i, 0], angles[i, 1], angles[i, 2]), work_of[0]
            step_links(angles[i], rates[i], heat[i], force, wait_s, hand, friction, writes[i], work_of, work, jacobian)
            gave = work_of[0] - gave
            given += gave
            for joint in range(3):  # what is viscous is left to the hand
                lost += friction * premium_model.COULOMB * abs(angles[i, joint] - before[joint])
            book[MOVED] += abs(gave)
    book[LEFT_WITH], book[SERVO] = given - lost, given
    book[GAINED] = max(book[GAINED], given - lost)


@kernel
def _shake(hand: FloatArray, angles: FloatArray, draw: int, shaken: FloatArray) -> None:
    """Write joint angles (3,) as encoders beside the edge of a count see them."""
    for joint in range(3):
        count = 2 * math.pi / (COUNTS * GEARS[joint])
        shaken[joint] = angles[joint] + hand[JITTER] * count * drawn(draw + joint)


@kernel
def _lead_hand(hand: FloatArray, centre: FloatArray, k: int, target: FloatArray, arm_hand: FloatArray) -> None:
    """Move the point to which a hand pulls its arm by a tick, and write that hand (HAND_SIZE,) for the arm."""
    arm_hand[HAND_STIFFNESS] = move_target(hand, target, k)
    arm_hand[HAND_DAMPING], arm_hand[HAND_GRIP] = hand[HAND_LOSS], hand[GRIP]
    for axis in range(2):  # across the wall is z, along it y
        target[axis] += TICK_S * target[2 + axis]
        arm_hand[HAND_TARGET + 2 - axis] = centre[2 - axis] + target[axis]
        arm_hand[HAND_RATE + 2 - axis] = target[2 + axis]
    arm_hand[HAND_TARGET] = centre[0]


@kernel
def _answer(hand: FloatArray, between: float, motion: FloatArray, other_m: float, answer: FloatArray) -> None:
    """Write the local model of a side of the tissue for a pose of this hand, and where the other hand is then."""
    answer[:] = 0.0
    own, both = hand[WALL] * (motion[2] < 0.0), between * (motion[2] + other_m < 0.0)
    if own + both == 0.0:
        return
    answer[MODEL_CONTACT] = 1.0
    answer[MODEL_F0 + 2] = -own * motion[2] - both * (motion[2] + other_m)
    answer[MODEL_K + 8] = hand[MODEL] * (own + both)
    answer[MODEL_B] = answer[MODEL_B + 4] = answer[MODEL_B + 8] = hand[DAMPING]
    answer[MODEL_X0 : MODEL_X0 + 3] = motion[:3]
