"""One wall, many laws: how stiff each may be on each arm, and how it is felt when it is met, pressed and left.

The arm is a mass with dry and viscous friction and an encoder, whose velocity is filtered as the arm's driver does it;
what hands do is drawn once, the same for every law. The wall is computed in the servo itself: nothing is late.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.gateway.servo.velocity_filter import butterworth
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config import config
from trocar.studies.feel.hunt import MASSES_KG
from trocar.studies.feel.laws import VISCOUS_N_S_M, Make, Walls
from trocar.studies.feel.laws.bare import Bare
from trocar.studies.feel.laws.chai3d import Chai3d
from trocar.studies.feel.laws.eba import Eba
from trocar.studies.feel.laws.energy_bound import EnergyBound
from trocar.studies.feel.laws.openhaptics import OpenHaptics
from trocar.studies.feel.laws.tdpa import Tdpa

LAWS: dict[str, Make] = {
    "the rig's, energy bounded": EnergyBound,
    "a spring alone": Bare,
    "energy bounding (EBA)": Eba,
    "passivity observer (TDPA)": Tdpa,
    "as CHAI3D": Chai3d,
    "as OpenHaptics": OpenHaptics,
}
TICK_S, _SUBSTEPS, _GRIP_N = 1e-3, 4, 15.0
_ARRIVING = 50
#: Stiffnesses that are tried, N/m.
TRIED_N_M = np.round(np.geomspace(50.0, 10_000.0, 24))
#: More than this is a gain, J: what rounding leaves is far below.
GAIN_J = 1e-7
#: A hand tells forces apart that differ by 7 % (Pang, Tan and Durlach, 1991), and 20 mN from nothing.
NOTICED, LEAST_N = 0.07, 0.02
_FELT_N_M, _MET_M_S, _LEFT_M_S = 500.0, 0.2, 0.7


@dataclass(frozen=True)
class Hands:
    """What hands do, tick by tick: where they want to be, (n, ticks), in m; how stiff they are, N/m; their damping."""

    target_m: FloatArray
    stiffness_n_m: FloatArray
    damping_n_s_m: FloatArray


@dataclass(frozen=True)
class Run:
    """What came of lanes: true depth x and force in every tick, (n, ticks), and energy got once they had left, (n,)."""

    x_m: FloatArray
    force_n: FloatArray
    gained_j: FloatArray


@dataclass(frozen=True)
class Device:
    """An arm on one axis: its file, its mass and viscous friction, and whether its velocity is filtered."""

    file: ArmFile
    mass_kg: float
    viscous_n_s_m: float = VISCOUS_N_S_M
    is_filtered: bool = True


@dataclass(frozen=True)
class Compared:
    """One law on one arm.

    Attributes:
        stiffest_n_m, rendered_n_m: Of the walls tried the stiffest up to which no hand gained, and how stiff that one
            is felt.
        onset_ms, loss_ms: Until the force is within 10 % of the wall's after it is met at 0.2 m/s; until it is gone
            after it is left.
        noticed: Share of ticks in which a slow hand would tell the force from that of a wall of 500 N/m.
    """

    law: str
    arm: str
    stiffest_n_m: float
    rendered_n_m: float
    onset_ms: float
    loss_ms: float
    noticed: float


def arm_file(name: str) -> ArmFile:
    """Return a device file by its name."""
    return config.load(ArmFile, config.find("device", name))[0]


def device_of(arm: str) -> Device:
    """Return the arm of a device file."""
    return Device(arm_file(arm), MASSES_KG[arm])


def compare(hands: int, seed: int = 0, arms: Sequence[str] = tuple(MASSES_KG)) -> list[Compared]:
    """Return every law on every arm, against `hands` hands that try to get energy out."""
    return [_compared(law, arm, drawn_hands(hands, seed)) for law in LAWS for arm in arms]


def _compared(law: str, arm: str, hands: Hands) -> Compared:
    stiffest = stiffest_passive(law, arm, hands)
    onset_ms, loss_ms = met_and_left(law, arm)
    return Compared(law, arm, stiffest, rendered(law, arm, stiffest), onset_ms, loss_ms, noticed(law, arm))


def stiffest_passive(law: str, arm: str, hands: Hands) -> float:
    """Return the stiffest wall tried, N/m, up to which none of the hands gained; 0 where each lets one gain."""
    return stiffest_of(LAWS[law], device_of(arm), hands)


def stiffest_of(make: Make, device: Device, hands: Hands) -> float:
    """Return that of any law on any device."""
    n = len(hands.target_m)
    target, stiff = (np.tile(each, (len(TRIED_N_M), 1)) for each in (hands.target_m, hands.stiffness_n_m))
    lanes = Hands(target, stiff, np.tile(hands.damping_n_s_m, len(TRIED_N_M)))
    run = move_at(make, device, np.repeat(TRIED_N_M, n), lanes)
    gains = (run.gained_j.reshape(len(TRIED_N_M), n) > GAIN_J).any(axis=1)
    first = int(np.argmax(gains)) if gains.any() else len(TRIED_N_M)
    return float(TRIED_N_M[first - 1]) if first else 0.0


def rendered(law: str, arm: str, stiffness_n_m: float) -> float:
    """Return force over depth, N/m, of a wall that a hand of 2,000 N/m presses slowly with 1 N."""
    return rendered_at(LAWS[law], device_of(arm), stiffness_n_m) if stiffness_n_m else 0.0


def rendered_at(make: Make, device: Device, stiffness_n_m: float) -> float:
    """Return that of any law on any device."""
    depth_m = 1.0 * (1.0 / stiffness_n_m + 1.0 / 2000.0)
    path = np.concatenate([np.linspace(1e-4, -depth_m, 600), np.full(400, -depth_m)])
    run = move_at(make, device, np.array([stiffness_n_m]), _steady(path, 2000.0, device.mass_kg))
    return float(np.median(run.force_n[0, -200:] / np.maximum(1e-9, -run.x_m[0, -200:])))


def met_and_left(law: str, arm: str) -> tuple[float, float]:
    """Return after how many ms the force of a wall of 500 N/m is there, and is gone."""
    into = 1e-3 - _MET_M_S * TICK_S * np.arange(26)
    out = into[-1] + _LEFT_M_S * TICK_S * np.arange(40)
    path = np.concatenate([into, np.full(100, into[-1]), out])
    run = move(law, arm, np.array([_FELT_N_M]), _steady(path, 5000.0, MASSES_KG[arm]))
    wall = np.clip(-_FELT_N_M * run.x_m[0], 0.0, None)
    there = (wall > 0.0) & (np.abs(run.force_n[0] - wall) < 0.1 * wall)
    met = int(np.argmax(wall > 0.0))
    left = len(wall) - int(np.argmax(wall[::-1] > 0.0))
    felt = len(wall) - int(np.argmax(np.abs(run.force_n[0, ::-1]) > LEAST_N))
    return 1e3 * TICK_S * int(np.argmax(there[met:])), 1e3 * TICK_S * max(0, felt - left)


def noticed(law: str, arm: str, hands: int = 40, seed: int = 1) -> float:
    """Return in which share of ticks at a wall of 500 N/m slow hands would tell the force from the wall's."""
    random, ticks = np.random.default_rng(seed), 1200
    hertz, depth = random.uniform(0.3, 1.5, (hands, 1)), random.uniform(0.5e-3, 3e-3, (hands, 1))
    path = 5e-4 - (depth + 5e-4) * np.sin(np.pi * hertz * TICK_S * np.arange(ticks)) ** 2
    mass_kg = MASSES_KG[arm]
    slow = Hands(path, np.full((hands, ticks), 800.0), np.full(hands, 2.0 * np.sqrt(mass_kg * 800.0)))
    run = move(law, arm, np.full(hands, _FELT_N_M), slow)
    wall = np.clip(-_FELT_N_M * run.x_m, 0.0, None)
    told = np.abs(run.force_n - wall) > np.maximum(NOTICED * wall, LEAST_N)
    return float(told[wall > 0.0].mean())


def _steady(path_m: FloatArray, stiffness_n_m: float, mass_kg: float) -> Hands:
    damping = 2.0 * np.sqrt(mass_kg * stiffness_n_m)
    return Hands(path_m[None], np.full((1, len(path_m)), stiffness_n_m), np.array([damping]))


def drawn_hands(count: int, seed: int, ticks: int = 900, leaving: int = 150) -> Hands:
    """Return hands that press, rest, draw back and leave; half of them are soft while they press."""
    random = np.random.default_rng(seed)

    def decades(low: float, high: float) -> FloatArray:
        return np.exp(random.uniform(np.log(low), np.log(high), count))

    stiff, damping, soft = decades(50.0, 5000.0), decades(0.2, 10.0), decades(0.02, 1.0)
    soft[random.random(count) < 0.5] = 1.0
    depth, press, draw = decades(0.05e-3, 10e-3), decades(0.005, 1.0), decades(0.005, 1.2)
    rest, out = decades(0.5e-3, 0.1), random.uniform(-2e-3, 5e-3, count)
    out = np.maximum(out, -0.9 * depth)
    target, stiffness = np.zeros((count, ticks + leaving)), np.zeros((count, ticks + leaving))
    into, back = (depth + out) / press, (depth + out) / draw
    whole = into + back + 2.0 * rest
    for k in range(ticks):
        s = np.mod(TICK_S * k, whole)
        presses = s < into
        target[:, k] = np.select(
            [presses, s < into + rest, s < into + rest + back],
            [out - press * s, -depth, -depth + draw * (s - into - rest)],
            out,
        )
        stiffness[:, k] = stiff * np.where(presses, soft, 1.0)
    outside = np.maximum(out, 0.0)[:, None] + 1e-4  # who begins in the wall has energy that nobody put in
    target[:, :_ARRIVING] = outside + (target[:, [_ARRIVING]] - outside) * np.arange(_ARRIVING) / _ARRIVING
    target[:, ticks:] = target[:, [ticks - 1]] + 0.2 * TICK_S * np.arange(1, leaving + 1)
    stiffness[:, ticks:] = 200.0
    return Hands(target, stiffness, damping)


def move(law: str, arm: str, stiffness_n_m: FloatArray, hands: Hands) -> Run:
    """Run lanes, each a hand at a wall of its stiffness, and book what each has got out past all friction."""
    return move_at(LAWS[law], device_of(arm), stiffness_n_m, hands)


def move_at(make: Make, device: Device, stiffness_n_m: FloatArray, hands: Hands) -> Run:
    """Run lanes with any law on any device."""
    file = device.file
    servo = make(Walls(file, stiffness_n_m, TICK_S))
    n, ticks = hands.target_m.shape
    x, v, seen_before = hands.target_m[:, 0].copy(), np.zeros(n), hands.target_m[:, 0].copy()
    coefficients, filtered = butterworth(file.velocity_filter_hz), np.zeros((2, n))
    place = np.random.default_rng(2).random(n) * file.count_m
    xs, forces = np.zeros((n, ticks)), np.zeros((n, ticks))
    given, lost, gained = np.zeros(n), np.zeros(n), np.full(n, -np.inf)
    wanted_before = hands.target_m[:, 0]
    for k in range(ticks):
        seen = np.floor((x + place) / file.count_m) * file.count_m - place
        raw = (seen - seen_before) / TICK_S if k else np.zeros(n)
        seen_before = seen
        force = servo.force(seen, _filtered(raw, filtered, coefficients) if device.is_filtered else raw)
        free = force == 0.0
        gained[free] = np.maximum(gained, given - lost)[free]
        xs[:, k], forces[:, k] = x, force
        wanted = hands.target_m[:, k]
        speed = np.clip((wanted - wanted_before) / TICK_S, -2.0, 2.0)
        wanted_before = wanted
        before = x.copy()
        for _ in range(_SUBSTEPS):
            hand = hands.stiffness_n_m[:, k] * (wanted - x) + hands.damping_n_s_m * (speed - v)
            v, taken = _pushed(v, force + np.clip(hand, -_GRIP_N, _GRIP_N), device)
            lost += taken
            x = x + TICK_S / _SUBSTEPS * v
        given += force * (x - before)
    return Run(xs, forces, np.maximum(gained, given - lost))


def _pushed(v: FloatArray, push_n: FloatArray, device: Device) -> tuple[FloatArray, FloatArray]:
    """Return speeds a part of a tick later, and what friction has taken of the energy, J."""
    dt, mass_kg = TICK_S / _SUBSTEPS, device.mass_kg
    v = v + dt / mass_kg * push_n
    slower = np.abs(v) * (1.0 - dt / mass_kg * device.viscous_n_s_m) - dt / mass_kg * device.file.friction_n
    after = np.sign(v) * np.maximum(0.0, slower)
    return after, mass_kg * (np.abs(v) - np.abs(after)) * np.abs(after)


def _filtered(raw: FloatArray, state: FloatArray, coefficients: FloatArray) -> FloatArray:
    b0, b1, b2, a1, a2 = coefficients
    value = b0 * raw + state[0]
    state[0] = b1 * raw - a1 * value + state[1]
    state[1] = b2 * raw - a2 * value
    found: FloatArray = value
    return found
