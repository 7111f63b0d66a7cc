"""Instruments in the hands of a person at the page: they follow, yield, wait, and never leave reach."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trocar import protocol
from trocar.protocol import Frame
from trocar.protocol.bodies import Hands, HandTarget
from trocar.protocol.bodies.haptics import MODEL_COLUMNS, MODEL_F0
from trocar.services.gateway import drivers
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.hands import virtual_hand
from trocar.services.gateway.hands.hand_arm import LOOK_EVERY
from trocar.services.gateway.servo import pose, servo_arrays
from trocar.services.runtime.config.rig import DriverSettings, Mount
from trocar.services.runtime.errors import ConfigError

TICK_NS = 1_000_000
MOUNT = Mount(centre_m=(0.065, -0.005, 0.02), yaw_rad=0.9)
CENTRE = np.array(MOUNT.centre_m)
PORT = (0.075, -0.06, 0.12)


class Page:
    """What the gateway has heard from the page."""

    def __init__(self) -> None:
        self.frame: Frame | None = None

    def say(self, *hands: HandTarget, valid: bool = True, begins: int = 0) -> None:
        body = Hands(hands=hands, begins=begins)
        self.frame = Frame(protocol.PROTOCOL_VERSION, "visualization.hands", 1, 1, 0, 0, 0, valid, body)

    def __call__(self, topic: str) -> Frame | None:
        assert topic == "visualization.hands"
        return self.frame


class Bench:
    """An arm of the page and its clock."""

    def __init__(self, **settings: Any) -> None:
        self.page = Page()
        place = Place("left", MOUNT, PORT, newest=self.page)
        self.arm = drivers.load_arm(DriverSettings(driver="web", settings=settings), place)
        self.grasp = drivers.load_grasp(DriverSettings(driver="grasp_web"), place)
        self.arm.open()
        self.now_ns = TICK_NS
        self.reading, self.handle = np.zeros(servo_arrays.READ_SIZE), np.zeros(servo_arrays.HANDLE_SIZE)
        self.motion, self.orientation = np.zeros(6), np.zeros(4)

    def run(self, ticks: int, force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
        """Return where the junction was in the world after each tick, (ticks, 3), under a force in the world."""
        path = np.zeros((ticks, 3))
        model, limits = np.zeros(MODEL_COLUMNS), np.ones(servo_arrays.LIMIT_SIZE) * 1e3
        model[MODEL_F0 : MODEL_F0 + 3] = force_n
        now, memory = np.zeros(servo_arrays.NOW_SIZE), np.zeros(servo_arrays.MEMORY_SIZE)
        now[servo_arrays.NOW_TTL], now[servo_arrays.NOW_GAIN], now[servo_arrays.NOW_DT] = 0.02, 1.0, 1e-3
        for k in range(ticks):
            self.arm.read(self.now_ns, self.reading)
            self.grasp.read(self.now_ns, self.handle)
            pose.place_tool(self.reading, pose.pack_mount(MOUNT), np.array(PORT), self.motion, self.orientation)
            self.arm.evaluate(model, self.motion, limits, now, memory)
            path[k] = self.motion[:3]
            self.now_ns += TICK_NS
        return path


def target(*position_m: float, **rest: float) -> HandTarget:
    return HandTarget(name="left", position_m=position_m, **rest)  # type: ignore[arg-type]


def test_the_tool_waits_where_the_rig_file_says_until_somebody_takes_it() -> None:
    bench = Bench(start_hip_m=(0.06, 0.0, 0.03), start_roll_rad=1.2)
    np.testing.assert_allclose(bench.run(300), np.tile([0.06, 0.0, 0.03], (300, 1)), atol=1e-12)
    assert bench.reading[servo_arrays.READ_ROLL] == pytest.approx(1.2)


def test_it_follows_smoothly_and_velocity_is_the_rate_of_position() -> None:
    bench = Bench()
    bench.page.say(target(*np.add(CENTRE, (0.02, 0.01, -0.01)), roll_rad=0.5, opening=0.0))
    path = bench.run(600)
    np.testing.assert_allclose(path[-1], np.add(CENTRE, (0.02, 0.01, -0.01)), atol=1e-5)
    steps = np.diff(path, axis=0)
    fastest = virtual_hand.GRIP_N / virtual_hand.DAMPING_N_S_M
    assert np.linalg.norm(steps, axis=1).max() / 1e-3 <= fastest * 1.001
    assert np.linalg.norm(np.diff(steps, axis=0), axis=1).max() / 1e-6 <= 1.05 * virtual_hand.GRIP_N / 0.1
    assert bench.reading[servo_arrays.READ_ROLL] == pytest.approx(0.5)
    assert bench.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(0.401)  # of 1 rad, 599 ms at 1 rad/s
    assert bench.handle[servo_arrays.HANDLE_RATE] == pytest.approx(-1.0)


def test_it_yields_to_a_force_as_the_spring_of_the_hand_says() -> None:
    bench = Bench()
    bench.page.say(target(*CENTRE))
    path = bench.run(2000, (0.0, 0.6, 0.0))
    np.testing.assert_allclose(path[-1] - CENTRE, [0.0, 0.6 / virtual_hand.STIFFNESS_N_M, 0.0], atol=1e-6)


def test_it_stays_within_reach_whatever_the_page_asks() -> None:
    bench = Bench(reach_m=0.03)
    for far in ([9.0, 0.0, 0.0], [0.0, -1e6, 1e6], [0.0, 0.0, 1e300]):
        bench.page.say(target(*far))
        assert np.linalg.norm(bench.run(1500) - CENTRE, axis=1).max() < 0.0301


def test_a_frame_that_says_it_is_not_valid_or_of_another_instrument_moves_nothing() -> None:
    bench = Bench()
    bench.page.say(target(*(CENTRE + 0.01)), valid=False)
    still = bench.run(50)
    bench.page.say(renamed(target(*(CENTRE + 0.01)), "right"))
    np.testing.assert_allclose(np.vstack((still, bench.run(50))), np.tile(CENTRE, (100, 1)), atol=1e-12)


def renamed(hand: HandTarget, name: str) -> HandTarget:
    return HandTarget(name=name, position_m=hand.position_m)


def test_lost_ticks_are_taken_in_bounded_steps() -> None:
    bench = Bench()
    bench.page.say(target(*np.add(CENTRE, (0.05, 0.0, 0.0))))
    bench.run(LOOK_EVERY + 20)
    before = bench.motion[:3].copy()
    bench.now_ns += 5_000 * TICK_NS
    bench.run(1)
    assert np.linalg.norm(bench.motion[:3] - before) < 0.02 * 0.33


def test_a_workspace_with_the_port_in_it_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"instrument 'left', driver 'web': reach_m: 0.11 m .* reaches the port, 0.115"
    ):
        Bench(reach_m=0.11)
    with pytest.raises(ConfigError, match="start_hip_m: is farther than reach_m"):
        Bench(start_hip_m=(0.2, 0.0, 0.0))


def test_the_rig_for_a_mouse_has_its_hands_at_the_page() -> None:
    from trocar.services.runtime.config import config

    rig = config.load_rig("mouse")
    assert rig.page_hands() == ("left", "right")
    stub = config.load_rig("stub")
    same = {"name": "stub", "base": None, "gateway": stub.gateway}
    assert rig.model_copy(update=same) == stub, "they differ in their hands only"
    for row, other in zip(rig.gateway.instruments, stub.gateway.instruments, strict=True):
        assert (row.name, row.mount, row.port_m) == (other.name, other.mount, other.port_m)


def test_it_begins_again_where_it_waited_and_lets_hands_of_before_be() -> None:
    bench = Bench()
    waits, away = bench.run(50)[-1], CENTRE + 0.02
    opened = bench.handle[servo_arrays.HANDLE_ANGLE]
    told = HandTarget(name="left", position_m=tuple(away), roll_rad=0.5, opening=0.0)
    bench.page.say(told)
    assert np.allclose(bench.run(600)[-1], away, atol=1e-3)
    bench.arm.begin_again()
    bench.grasp.begin_again()
    path = bench.run(600)
    assert np.abs(path - waits).max() < 1e-6, "the page goes on saying where its hand was"
    assert bench.handle[servo_arrays.HANDLE_ANGLE] == opened
    bench.page.say(told, begins=1)
    assert np.allclose(bench.run(600)[-1], away, atol=1e-3)
