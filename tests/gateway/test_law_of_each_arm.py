"""The servo's law with each arm's own encoder count, friction and filter."""

from __future__ import annotations

import numpy as np
import pytest

from protocol.bodies.haptics import MODEL_CONTACT, MODEL_F0, MODEL_K, MODEL_X0
from services.gateway.device_files import ArmFile
from services.gateway.velocity_filter import butterworth, low_pass
from services.runtime import config
from tests.gateway.test_servo_law import DT_S, STEP_N, Law

ARMS = ("phantom_premium_1_5", "touch", "touch_x")


def arm_file(name: str) -> ArmFile:
    return config.load(ArmFile, config.find("device", name))[0]


def slipped(name: str, counts: float, speed_m_s: float) -> float:
    """Return by how much a force of 1 N is braked, N, that slips by so many counts while three joints turn alike."""
    limits = arm_file(name).limits()
    law = Law(damping_n_s_m=limits.max_damping_n_s_m, count_m=limits.count_m, friction_n=limits.friction_n)
    law.load(force_n=(1.0, 0.0, 0.0), in_contact=True)
    before = law.settle()
    law.motion[0], law.motion[3:] = counts * limits.count_m, speed_m_s / np.sqrt(3.0)
    return float(np.linalg.norm(law.force() - before))


@pytest.mark.parametrize("name", ARMS)
def test_a_count_of_an_arms_own_encoders_does_not_kick_and_three_do(name: str) -> None:
    """A count in each of three joints, seen at the speed that the arm's own filter makes of it."""
    file = arm_file(name)
    count_m_s = np.sqrt(3.0) * file.count_m / DT_S * largest_of_a_step(file.velocity_filter_hz)
    assert slipped(name, 1.0, count_m_s) == pytest.approx(0.0, abs=1e-9)
    assert slipped(name, 3.0, 3.0 * count_m_s) == pytest.approx(min(file.max_damping_n_s_m * 3 * count_m_s, STEP_N))


@pytest.mark.parametrize("name", ARMS)
def test_what_is_slower_than_a_count_in_three_ticks_is_braked_by_no_noise(name: str) -> None:
    file = arm_file(name)
    edge_m_s = file.count_m / 0.003
    assert slipped(name, 20.0, 0.99 * edge_m_s) == pytest.approx(0.0, abs=1e-9)
    assert slipped(name, 20.0, 1.01 * edge_m_s) == pytest.approx(file.max_damping_n_s_m * 1.01 * edge_m_s)


def largest_of_a_step(cut_off_hz: float) -> float:
    """Return the most that the filter of the velocity shows of a single 1."""
    state, coefficients = np.zeros((2, 3)), butterworth(cut_off_hz)
    return max(low_pass(float(k == 0), state, 0, coefficients) for k in range(20))


class Rubbing:
    """A mass with an arm's own count and Coulomb friction, in a hand that goes to and fro across a wall that is late.

    ``gained_j`` is what came out of the servo and was not taken by friction.
    """

    MASS_KG, SUBSTEPS = 0.045, 10

    def __init__(self, name: str, seed: int, *, controller: bool) -> None:
        file, random = arm_file(name), np.random.default_rng(seed)
        self.limits = limits = file.limits()
        damping = limits.max_damping_n_s_m if controller else 0.0
        self.law = Law(3.0, damping_n_s_m=damping, count_m=limits.count_m, friction_n=limits.friction_n)
        self.coefficients, self.filter = butterworth(file.velocity_filter_hz), np.zeros((2, 3))
        self.stiffness = float(np.exp(random.uniform(np.log(30.0), np.log(5000.0))))
        self.delay = int(random.integers(1, 15))
        self.hand = float(np.exp(random.uniform(np.log(50.0), np.log(2000.0))))
        self.depth_m, self.hertz = random.uniform(0.5e-3, 6e-3), float(np.exp(random.uniform(0.0, np.log(60.0))))
        self.x, self.v, self.read, self.gained_j = 0.0, 0.0, 0.0, 0.0
        self.answers: list[tuple[float, float]] = []

    def run(self, ticks: int) -> float:
        for k in range(ticks + 300):
            force = self.serve()
            target = self.depth_m * np.sin(2.0 * np.pi * self.hertz * k * DT_S) if k < ticks else 0.01
            dt = DT_S / self.SUBSTEPS
            for _ in range(self.SUBSTEPS):
                push = force + self.hand * (target - self.x) - 3.0 * self.v
                self.v += dt / self.MASS_KG * push
                stop = dt / self.MASS_KG * self.limits.friction_n
                after = np.sign(self.v) * max(0.0, abs(self.v) - stop)
                rubbed = self.MASS_KG * abs(self.v - after) / dt
                self.v = float(after)
                self.x += dt * self.v
                self.gained_j += force * dt * self.v - rubbed * dt * abs(self.v)
        return self.gained_j

    def serve(self) -> float:
        count_m, law = self.limits.count_m, self.law
        read = float(np.floor(self.x / count_m) * count_m)
        law.motion[0], law.motion[3] = read, low_pass((read - self.read) / DT_S, self.filter, 0, self.coefficients)
        self.read = read
        self.answers.append((max(0.0, -read) * self.stiffness, read))
        if len(self.answers) > self.delay:
            force, at = self.answers[-1 - self.delay]
            law.model[MODEL_F0], law.model[MODEL_X0] = force, at
            law.model[MODEL_CONTACT] = float(force > 0.0)
            law.model[MODEL_K] = self.stiffness if force > 0.0 else 0.0
        return float(law.force(self.delay * DT_S)[0])


@pytest.mark.parametrize("name", ["touch", "touch_x"])
def test_no_hand_gets_energy_out_of_an_arm_with_a_count_and_friction_of_its_own(name: str) -> None:
    assert max(Rubbing(name, seed, controller=True).run(600) for seed in range(24)) <= 0.0
    assert max(Rubbing(name, seed, controller=False).run(600) for seed in range(24)) > 1e-3
