from __future__ import annotations

import numpy as np

from trocar.services.gateway.motions.script import ROLL, Breakpoint, Motion, Player
from trocar.services.gateway.servo.servo_arrays import READ_ROLL, READ_SIZE
from trocar.services.gateway.simulated import premium_model, simulated_arm
from trocar.services.gateway.simulated.arm_tick import ArmTick, tick_arm
from trocar.services.gateway.simulated.simulated_arm import ArmState

PORT = (0.075, -0.06, 0.12)
STAND = np.array([0.6, 0.8, 0.03, -0.01, 0.02, *premium_model.centre()])


def _player(beyond_hip_m: float) -> Player:
    points = [(0.0, (0.03, -0.01, 0.02), 0.1), (0.05, (0.04, 0.0, 0.01), -0.2), (0.09, (0.03, -0.02, 0.02), 0.3)]
    rows = tuple(Breakpoint(time_s=time_s, hip_m=hip_m, roll_rad=roll) for time_s, hip_m, roll in points)
    return Player(Motion(beyond_hip_m=beyond_hip_m, breakpoints=rows), loop=True, port_m=PORT)


def _hand() -> np.ndarray:
    hand = np.zeros(simulated_arm.HAND_SIZE)
    hand[simulated_arm.HAND_STIFFNESS :] = 300.0, 5.0, 20.0
    return hand


def test_one_kernel_does_what_its_parts_do_one_by_one() -> None:
    for beyond_m, tremor_m in ((0.0, 0.0), (0.012, 0.0), (0.012, 0.2e-3)):
        whole, apart = _player(beyond_m), _player(beyond_m)
        fused, arm = (ArmState(np.array(premium_model.CENTRE_ANGLES), 100.0) for _ in range(2))
        force, centre = np.array([0.4, -0.3, 0.2]), premium_model.centre()
        hand, reading, seen = _hand(), np.zeros(READ_SIZE), np.zeros(READ_SIZE)
        tick = ArmTick(
            times=whole.times, values=whole.values, value=whole.value, rate=whole.rate, port=whole.port,
            beyond_m=whole.beyond_m, tremor_m=tremor_m, stand=STAND, hand=_hand(), angles=fused.angles,
            rates=fused.rates, heat=fused.heat, force=force, work=fused.work, jacobian=fused.jacobian,
            measured=fused.measured, filter=fused.filter, coefficients=fused.coefficients, centre=centre,
            reading=seen, writes=fused.writes, given=fused.given,
        )  # fmt: skip
        for k in range(150):
            tick_arm(tick.address, whole.within(1e-3 * k), 1e-3 * k)
            apart.sample(1e-3 * k)
            simulated_arm.place_hand(apart.value, apart.rate, STAND, hand)
            simulated_arm.tremble(hand, tremor_m, 1e-3 * k)
            arm.step(force, hand)
            arm.read(centre, reading)
            reading[READ_ROLL] = apart.value[ROLL]
            np.testing.assert_array_equal(seen, reading)
        assert np.linalg.norm(fused.rates) > 0.01
