"""The servo's law with each arm's own encoder count, friction and filter."""

from __future__ import annotations

import numpy as np
import pytest

from tests.gateway.kicks import ENDLESS_N
from tests.gateway.servo.test_servo_law import DT_S, Law
from trocar.protocol.bodies.haptics import MODEL_CONTACT, MODEL_F0, MODEL_K, MODEL_X0
from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.gateway.servo.velocity_filter import butterworth, low_pass
from trocar.services.runtime.config import config

ARMS = tuple(
    sorted(
        path.stem for path in (config.config_directory() / "devices").glob("*.yaml") if "kind: arm" in path.read_text()
    )
)


def arm_file(name: str) -> ArmFile:
    return config.load(ArmFile, config.find("device", name))[0]


@pytest.mark.parametrize("name", ARMS)
def test_a_count_of_an_arms_own_encoders_does_not_kick(name: str) -> None:
    """A hand that rests two counts and more in a wall and slips by one feels the spring over the count, no more."""
    limits = arm_file(name).limits()
    law = Law(count_m=limits.count_m, friction_n=limits.friction_n)
    stiffness_n_m = 0.5 * limits.friction_n / limits.count_m
    law.load(stiffness_n_m=(stiffness_n_m, 0, 0, 0, stiffness_n_m, 0, 0, 0, stiffness_n_m), in_contact=True)
    for counts in (*range(1, 11), 9, 10, 9, 8, 9, 10):
        law.motion[0] = -counts * limits.count_m
        law.force()
        assert law.force()[0] == pytest.approx(-stiffness_n_m * law.motion[0])


class Rubbing:
    """A mass with an arm's own count and Coulomb friction, in a hand that goes to and fro across a wall that is late.

    ``gained_j`` is what came out of the servo and was not taken by friction.
    """

    MASS_KG, SUBSTEPS = 0.045, 10

    def __init__(self, name: str, seed: int, *, bounded: bool) -> None:
        file, random = arm_file(name), np.random.default_rng(seed)
        self.limits = limits = file.limits()
        told_n = limits.friction_n if bounded else ENDLESS_N
        self.law = Law(3.0, count_m=limits.count_m, friction_n=told_n)
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


@pytest.mark.parametrize("name", [name for name in ARMS if name != "phantom_premium_1_5"])
def test_no_hand_gets_energy_out_of_an_arm_with_a_count_and_friction_of_its_own(name: str) -> None:
    assert max(Rubbing(name, seed, bounded=True).run(600) for seed in range(24)) <= 0.0
    assert max(Rubbing(name, seed, bounded=False).run(600) for seed in range(24)) > 1e-4
