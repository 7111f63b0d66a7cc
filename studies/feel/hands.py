"""Hands that try to get energy out of the servo: random ones, and ones that know how."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from trocar.protocol.bodies.haptics import MODEL_COLUMNS, MODEL_CONTACT, MODEL_F0, MODEL_K, MODEL_X0
from trocar.protocol.topics import TICK_S
from trocar.services.gateway.devices.device_files import SURE_FRICTION
from trocar.services.gateway.servo import servo_law
from trocar.services.gateway.servo.servo_arrays import (
    LIMIT_HANDLE,
    LIMIT_SIZE,
    MEMORY_FORCE,
    MEMORY_SIZE,
    NOW_AGE,
    NOW_DT,
    NOW_GAIN,
    NOW_LAST_LATE_S,
    NOW_LATE_S,
    NOW_SIZE,
    NOW_TTL,
    READ_POSITION,
    READ_SIZE,
    READ_VELOCITY,
)
from trocar.services.gateway.simulated import premium_model
from trocar.services.gateway.simulated.simulated_arm import (
    HAND_DAMPING,
    HAND_GRIP,
    HAND_RATE,
    HAND_SIZE,
    HAND_STIFFNESS,
    HAND_TARGET,
    ArmState,
)
from trocar.services.mechanics.arrays import FloatArray

TTL_S = 0.02
#: What the servo is told of how late forces act: longer than of the Premium's device file.
WRITE_S = 0.3e-3
#: Largest force and its rate: those of the stub rig.
FORCE_N, RATE_N_S = 3.0, 200.0


@dataclass(frozen=True)
class Attack:
    """One hand at one wall.

    Attributes:
        stiffness_n_m: Of the wall, which lies in the middle of the workspace across z and pushes up.
        bus_delay: Ticks from a pose to the model that answers it, at the servo.
        lost: Part of the models that never come.
        local: Whether stiffness travels, or only the force that the wall had when the model was made.
        bounded: Whether a force gives no more than was put in.
        hand_n_m, hand_n_s_m: Stiffness and damping of the hand.
        depth_m, hertz: How far it goes to and fro across the wall, and how often.
        cunning: 0: a sinusoid with noise; 1: a hand that is stiff while the wall pushes it out, and lets go while it
            goes in.
        seed
        write_s, write_jitter: How late a force acts after its reading, at most, and by which share of that earlier.
        friction: Dry friction of the arm, as a share of the model's: at least `SURE_FRICTION`.
    """

    stiffness_n_m: float
    bus_delay: int
    lost: float
    local: bool
    bounded: bool
    hand_n_m: float
    hand_n_s_m: float
    depth_m: float
    hertz: float
    cunning: float
    seed: int
    write_s: float = 0.0
    write_jitter: float = 0.0
    friction: float = 1.0


def random_attack(seed: int, *, local: bool = True, bounded: bool = True) -> Attack:
    """Return attack `seed`: stiffnesses and frequencies spread over decades, delays to 19 ticks, up to half lost."""
    draw = np.random.default_rng(seed)
    return Attack(
        stiffness_n_m=float(10.0 ** draw.uniform(1.5, 3.7)),
        bus_delay=int(draw.integers(1, 20)),
        lost=float(draw.choice([0.0, 0.05, 0.5])),
        local=local,
        bounded=bounded,
        hand_n_m=float(10.0 ** draw.uniform(1.0, 3.0)),
        hand_n_s_m=float(draw.uniform(0.2, 5.0)),
        depth_m=float(10.0 ** draw.uniform(-4.0, -2.2)),
        hertz=float(10.0 ** draw.uniform(-0.3, 2.0)),
        cunning=float(draw.integers(0, 2)),
        seed=seed,
        write_s=float(draw.uniform(0.0, WRITE_S)),
        write_jitter=float(draw.uniform()),
        friction=float(draw.uniform(SURE_FRICTION, 1.0)),
    )


@dataclass(frozen=True)
class Book:
    """Energy of one attack, in J.

    Attributes:
        servo_j: What the motors gave to the joints in all, the hand having left the wall: above 0 where more came out
            of the servo than went in.
        gained_j: The same without what the arm's own friction took: what is left for the hand.
        moved_j: All that went to and fro through the motors: what these are to be compared with.
    """

    servo_j: float
    gained_j: float
    moved_j: float


class Books:
    """What the motors of a simulated arm gave, and what the friction of its joints took, tick by tick, in J."""

    def __init__(self) -> None:
        self.given_j = self.lost_j = self.moved_j = 0.0

    def step(self, arm: ArmState, advance: Callable[[], None]) -> None:
        """Let the arm `advance` by a tick, and account for it."""
        angles, rates, before_j = arm.angles.copy(), arm.rates.copy(), float(arm.given[0])
        advance()
        given_j = float(arm.given[0]) - before_j
        self.given_j += given_j
        self.moved_j += abs(given_j)
        self.lost_j += _friction_j(angles, arm, rates)

    def close(self) -> Book:
        """Return the sums."""
        return Book(self.given_j, self.given_j - self.lost_j, self.moved_j)


class _Wall:
    """A wall across z that answers poses late: what haptics and physics are to the servo."""

    def __init__(self, attack: Attack, height_m: float, random: np.random.Generator) -> None:
        self._attack, self._height_m, self._random = attack, height_m, random
        self._waiting: list[FloatArray] = []
        self.model = np.zeros(MODEL_COLUMNS)
        self.age = 0

    def look(self, position: FloatArray) -> None:
        """Answer a pose, and give the servo what is due now."""
        self._waiting.append(self._answer(position))
        self.age += 1
        if len(self._waiting) > self._attack.bus_delay:
            due = self._waiting.pop(0)
            if self._random.random() >= self._attack.lost:
                self.model, self.age = due, self._attack.bus_delay

    def _answer(self, position: FloatArray) -> FloatArray:
        model = np.zeros(MODEL_COLUMNS)
        depth = self._height_m - position[2]
        if depth > 0.0:
            model[MODEL_F0 + 2], model[MODEL_CONTACT] = self._attack.stiffness_n_m * depth, 1.0
            if self._attack.local:
                model[MODEL_K + 8] = self._attack.stiffness_n_m
            model[MODEL_X0 : MODEL_X0 + 3] = position
        return model


def attack_servo(attack: Attack, ticks: int = 1500) -> Book:
    """Let a hand work on a wall for `ticks`, then leave, and return what the servo gave."""
    random = np.random.default_rng(attack.seed)
    arm = ArmState(np.array(premium_model.CENTRE_ANGLES), 100.0, attack.friction)
    centre = premium_model.centre()
    wall = _Wall(attack, 0.0, random)
    reading, motion, memory = np.zeros(READ_SIZE), np.zeros(6), np.zeros(MEMORY_SIZE)
    (limits, now), hand, books = servo_settings(bounded=attack.bounded), np.zeros(HAND_SIZE), Books()
    for k in range(ticks + 400):
        arm.read(centre, reading)
        motion[:3], motion[3:] = reading[READ_POSITION:][:3], reading[READ_VELOCITY:][:3]
        wall.look(motion[:3])
        now[NOW_AGE] = min(wall.age, 1000) * TICK_S
        servo_law.servo_force(wall.model, motion, limits, now, memory)
        _move_hand(attack, hand, centre, motion, k, ticks, random)
        force = memory[MEMORY_FORCE : MEMORY_FORCE + 3]
        wait_s = attack.write_s * (1.0 - attack.write_jitter * random.random())
        books.step(arm, partial(arm.step, force, hand, wait_s))
    return books.close()


def _friction_j(angles: FloatArray, arm: ArmState, rates: FloatArray) -> float:
    """Return what the joints' friction took over the way of a tick, J: the viscous one at the mean rate."""
    then = arm.angles
    middle, rate = (angles + then) / 2.0, (rates + arm.rates) / 2.0
    torques = np.array([premium_model.passive_torque(middle, rate, joint) for joint in range(3)])
    return float(arm.friction * premium_model.COULOMB * np.abs(then - angles).sum() - torques @ (then - angles))


def servo_settings(*, bounded: bool = True) -> tuple[FloatArray, FloatArray]:
    """Return the limits of the servo law, and its present as of a model that has just come: `layout` has their places.

    Args:
        bounded: Whether a force gives no more than was put in; else the law takes the arm's friction for endless.
    """
    limits, now = np.zeros(LIMIT_SIZE), np.zeros(NOW_SIZE)
    friction_n = SURE_FRICTION * premium_model.FRICTION_N if bounded else math.inf
    own = premium_model.COUNT_M, friction_n, 0.0
    limits[:LIMIT_HANDLE] = (FORCE_N, FORCE_N, RATE_N_S, 0.3, 30.0, *own)
    now[NOW_DT], now[NOW_TTL], now[NOW_GAIN] = TICK_S, TTL_S, 1.0
    now[NOW_LAST_LATE_S] = now[NOW_LATE_S] = WRITE_S
    return limits, now


def _move_hand(
    attack: Attack,
    hand: FloatArray,
    centre: FloatArray,
    motion: FloatArray,
    k: int,
    ticks: int,
    random: np.random.Generator,
) -> None:
    """Write where the hand wants to be: to and fro across the wall; at the end above it, in 0.2 s."""
    omega = 2.0 * math.pi * attack.hertz
    hand[HAND_TARGET : HAND_TARGET + 3] = centre
    hand[HAND_RATE : HAND_RATE + 3] = 0.0
    hand[HAND_STIFFNESS], hand[HAND_DAMPING], hand[HAND_GRIP] = attack.hand_n_m, attack.hand_n_s_m, 10.0
    if k >= ticks:
        hand[HAND_TARGET + 2] += 0.02
        hand[HAND_STIFFNESS], hand[HAND_DAMPING] = 100.0, 3.0
        return
    hand[HAND_TARGET + 2] -= attack.depth_m * math.sin(omega * k * TICK_S)
    hand[HAND_TARGET + 2] += 0.1 * attack.depth_m * random.standard_normal()
    hand[HAND_RATE + 2] = -attack.depth_m * omega * math.cos(omega * k * TICK_S)
    if attack.cunning and motion[5] < 0.0:
        hand[HAND_STIFFNESS] *= 0.1
