"""An Inverse3 on a stand-in of Haply's service: what is read, given, set, and chosen."""

from __future__ import annotations

import math
import socket
import threading
import time

import numpy as np
import pytest

from tests.gateway.devices.haply_bench import PUSH, RATE_N_S, HaplyBench, arms
from tests.gateway.devices.haply_service import CENTRE_M, to_and_fro
from trocar.services.gateway.drivers import check_host
from trocar.services.gateway.haply.grip import Grip
from trocar.services.gateway.haply.messages import GripEntry, GripState, Wxyz
from trocar.services.gateway.servo import servo_arrays
from trocar.services.runtime.config.rig import DriverSettings
from trocar.services.runtime.errors import ConfigError, DeviceError


def test_place_and_force_are_in_the_frame_of_the_arm() -> None:
    with arms() as bench:
        arm = bench.service.arms["049D"]
        arm.place = lambda _: (CENTRE_M[0] + 0.01, CENTRE_M[1] - 0.02, CENTRE_M[2] + 0.03)
        bench.open()
        bench.run(20)
        np.testing.assert_allclose(bench.places[-1], [0.02, 0.01, 0.03], atol=1e-12)
        np.testing.assert_allclose(bench.applied("049D"), PUSH)


def test_velocity_is_of_differences_whatever_the_service_tells() -> None:
    with arms() as bench:
        bench.service.arms["049D"].place = to_and_fro
        bench.open()
        bench.run(200)
        now_s = 1e-9 * bench.service.clock.monotonic_ns()
        velocity = bench.readings[0][servo_arrays.READ_VELOCITY :][:3]
        np.testing.assert_allclose(velocity, [0.0, 0.0, 0.02 * math.cos(now_s)], atol=2e-3)


def test_velocity_is_right_at_the_rate_that_the_service_holds() -> None:
    with arms() as bench:
        bench.service.arms["049D"].place = to_and_fro
        bench.service.after_s = 0.0015
        bench.open()
        bench.run(600)
        assert bench.drivers[0].gauges()["servo_rate_hz"] < 550.0
        now_s = 1e-9 * bench.service.clock.monotonic_ns()
        velocity = bench.readings[0][servo_arrays.READ_VELOCITY :][:3]
        np.testing.assert_allclose(velocity, [0.0, 0.0, 0.02 * math.cos(now_s)], atol=2e-3)


def test_a_force_comes_at_the_rigs_rate_and_is_answered_at_1_khz() -> None:
    with arms() as bench:
        bench.open()
        bench.run(100, np.array([0.0, 0.0, 3.0]))
        assert bench.largest_step_n() <= RATE_N_S * 1.5e-3 + 1e-9
        np.testing.assert_allclose(bench.applied("049D"), [0.0, 0.0, 3.0])
        assert bench.drivers[0].gauges()["servo_rate_hz"] == pytest.approx(1000.0, rel=0.01)


def test_the_age_of_what_is_read_is_a_part_of_the_delay_that_the_law_is_told() -> None:
    with arms() as bench:
        driver = bench.drivers[0]
        bench.open()
        bench.run(50)
        now_ns = bench.service.clock.monotonic_ns()
        assert driver.write_span_ns(now_ns, now_ns) == 2_000_000  # asked in the last tick but one, seen after this one
        bench.service.after_s = 0.0015
        bench.run(50)
        assert driver.write_span_ns(now_ns, now_ns) > 2_000_000


def test_what_the_service_adds_to_forces_is_set_and_told() -> None:
    with arms({"gravity_compensation": 0.5, "damping_n_s_m": 1.5, "force_gate": 0.2}) as bench:
        bench.open()
        config = bench.service.arms["049D"].config
        assert config["gravity_compensation"] == {"enabled": True, "scaling_factor": 0.5}
        assert config["filters"] == {"damping": {"scalar": 1.5}, "force_gate": {"gain": 0.2}}
        assert config["basis"] == {"permutation": "XYZ"}
        told = bench.drivers[0].gauges()
        assert (told["gravity_compensation"], told["damping_n_s_m"], told["force_gate_gain"]) == (0.5, 1.5, 0.2)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("basis", {"permutation": "XZY"}, "has its axes as XZY, not as XYZ"),
        ("gravity_compensation", {"enabled": False}, "bears 0 of its weight, not 1"),
        ("mount", {"scale": {"x": 2.0}}, "is mounted elsewhere"),
        ("filters", {"damping": {"scalar": 3.0}, "force_gate": {"gain": 0.3}}, "is damped with 3 N s/m, not 0"),
        ("filters", {"force_gate": {"gain": 0.9}}, "has a force gate of 0.9, not 0.3"),
    ],
)
def test_a_service_that_does_not_set_what_it_was_told_is_refused(key: str, value: dict[str, object], said: str) -> None:
    with arms() as bench:
        arm = bench.service.arms["049D"]
        tell = arm.tell

        def stubborn(now_s: float, whole: bool) -> dict[str, object]:
            told = tell(now_s, whole)
            return told | {"config": arm.config | {key: value}} if whole else told

        arm.tell = stubborn  # type: ignore[method-assign]
        with pytest.raises(DeviceError, match=f"instrument 'left': the arm {said}"):
            bench.open()


def test_what_differs_in_nothing_may_be_left_out() -> None:
    with arms({"gravity_compensation": 0.0, "force_gate": 0.0}) as bench:
        arm = bench.service.arms["049D"]
        tell = arm.tell
        arm.tell = lambda now_s, whole: tell(now_s, whole) | ({"config": {}} if whole else {})  # type: ignore[method-assign]
        bench.open()
        assert bench.drivers[0].gauges()["gravity_compensation"] == 0.0


def test_of_two_arms_each_driver_has_its_own() -> None:
    with arms({"id": "RIGHT"}, {"id": "LEFT"}, LEFT="inverse3", RIGHT="inverse3") as bench:
        bench.service.arms["LEFT"].place = lambda _: (0.05, -0.1, 0.2)
        bench.open()
        bench.run(50, np.array([0.0, 0.0, 0.4]), np.array([0.1, 0.2, 0.3]))
        np.testing.assert_allclose(bench.applied("RIGHT"), [0.0, 0.0, 0.4])
        np.testing.assert_allclose(bench.applied("LEFT"), [0.1, 0.2, 0.3])
        np.testing.assert_allclose(bench.readings[1][:3], [-0.02, 0.05, 0.05], atol=1e-12)


@pytest.mark.parametrize(
    ("settings", "kinds", "said"),
    [
        ({}, {"A": "inverse3", "B": "inverse3"}, r"several arms are plugged in \(A, B\): name one as `id`"),
        ({"id": "C"}, {"A": "inverse3"}, "no arm 'C'; it lists: A"),
        ({}, {"A": "minverse"}, "arm A is a minverse, its device file is of Inverse3"),
    ],
)
def test_an_arm_that_cannot_be_chosen_is_one_sentence(
    settings: dict[str, str], kinds: dict[str, str], said: str
) -> None:
    with arms(settings, **kinds) as bench, pytest.raises(DeviceError, match=said):
        bench.open()


def test_an_arm_of_two_instruments_is_refused_as_the_service_would_add_their_forces() -> None:
    with arms({"id": "A"}, {"id": "A"}, A="inverse3", B="inverse3") as bench:
        with pytest.raises(DeviceError, match="another instrument has arm A, and the service would add their forces"):
            bench.open()
        bench.drivers.pop().close()
        bench.drivers[0].close()
        bench.drivers[0].open()  # it is free again


def test_a_minverse_is_read_and_pushed_like_its_large_sister() -> None:
    with arms(device="minverse", M="minverse") as bench:
        bench.service.arms["M"].place = lambda _: (0.0, -0.08, 0.1)
        bench.open()
        bench.run(50)
        np.testing.assert_allclose(bench.places[-1], 0.0, atol=1e-12)
        np.testing.assert_allclose(bench.applied("M"), PUSH)


def test_a_service_that_is_not_there_is_one_sentence() -> None:
    with arms() as bench:
        bench.service.close()
        with pytest.raises(
            DeviceError, match=r"instrument 'left': no Haply service at localhost:\d+ \(Connection refused\)"
        ):
            bench.open()


@pytest.mark.parametrize("said", [b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n", b"220 smtp ready\r\n", b""])
def test_what_is_no_websocket_is_one_sentence(said: bytes) -> None:
    with arms() as bench, socket.create_server(("127.0.0.1", 0)) as door:
        settings = {"port": door.getsockname()[1]}

        def answer() -> None:
            peer, _ = door.accept()
            with peer:
                peer.recv(1 << 12)
                peer.sendall(said)

        thread = threading.Thread(target=answer)
        thread.start()
        driver = bench.driver(settings)
        bench.service.spoil = lambda _: None
        clock = driver._clock
        driver._clock = time  # type: ignore[assignment]  # the peer has a time of its own
        try:
            with pytest.raises(DeviceError, match=r"instrument 'left': no Haply service at localhost:\d+ \("):
                driver.open()
        finally:
            driver._clock = clock
            thread.join()


def test_an_older_service_is_refused_by_its_version() -> None:
    with arms() as bench:
        bench.service.is_old = True
        with pytest.raises(DeviceError, match=r"Haply's service is older than 3\.5, which is needed: update it"):
            bench.open()


def test_a_service_without_http_is_one_sentence() -> None:
    with arms() as bench:
        bench.service.http_status = 404
        with pytest.raises(DeviceError, match="refuses to set the compensation of weight: HTTP 404"):
            bench.open()


@pytest.mark.parametrize("port", [0, 70_000, "many"])
def test_a_port_that_cannot_be_is_refused_by_name(port: object) -> None:
    with arms() as bench, pytest.raises(ConfigError, match="driver 'haply': port"):
        bench.driver({"port": port})


def grip(turn_rad: float, **buttons: bool) -> dict[str, object]:
    return {
        "state": {
            "orientation": {"w": math.cos(turn_rad / 2), "x": 0.0, "y": 0.0, "z": math.sin(turn_rad / 2)},
            "buttons": buttons,
        },
        "status": {"awake": True},
    }


def roll(bench: HaplyBench) -> float:
    return float(bench.readings[0][servo_arrays.READ_ROLL])


def test_the_grip_turns_the_tool_beyond_a_full_turn_and_its_buttons_are_read() -> None:
    with arms() as bench:
        bench.service.grips["G"] = grip(0.0)
        bench.open()
        for turn in np.linspace(0.0, 8.0, 400).tolist():
            bench.service.grips["G"] = grip(turn, a=True, c=True)
            bench.run(1)
        bench.run(5)
        assert roll(bench) == pytest.approx(8.0)
        assert bench.drivers[0].buttons == 5


def test_a_grip_that_sleeps_keeps_the_tools_roll_and_is_told() -> None:
    with arms() as bench:
        bench.service.grips["G"] = grip(0.7, a=True)
        bench.open()
        bench.run(100)
        bench.service.grips["G"] = {"state": {}, "status": {"awake": False}}
        bench.run(100)
        assert roll(bench) == pytest.approx(0.7)
        assert bench.drivers[0].buttons == 0
        assert "the grip G sleeps" in bench.drivers[0].prompt
        assert bench.drivers[0].fault == ""
        np.testing.assert_allclose(bench.applied("049D"), PUSH)
        bench.service.grips["G"] = grip(0.9)
        bench.run(100)
        assert roll(bench) == pytest.approx(0.9)
        assert bench.drivers[0].prompt == ""


def test_of_several_grips_one_is_to_be_named() -> None:
    with arms() as bench:
        bench.service.grips.update({"G": grip(0.0), "H": grip(1.0)})
        with pytest.raises(DeviceError, match=r"several grips \(G, H\): name one as `grip`"):
            bench.open()
    with arms({"grip": "H"}) as bench:
        bench.service.grips.update({"G": grip(0.0), "H": grip(1.0)})
        bench.open()
        bench.run(100)
        assert roll(bench) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "wrong", [Wxyz(), Wxyz(1.0, 0.0, 0.0), Wxyz(5.0, 0.0, 0.0, 0.0), Wxyz(0.0, 1.0, 0.0, 0.0), Wxyz(*4 * [math.nan])]
)
def test_an_orientation_that_is_none_does_not_turn_the_tool(wrong: Wxyz) -> None:
    held = Grip("z")
    held.take(GripEntry("G", GripState(wrong)), 1_000_000)
    assert (held.roll_rad, held.awake) == (0.0, False)


def test_the_host_check_names_the_service_its_arms_and_what_is_missing() -> None:
    with arms() as bench:
        service, ended = bench.service, threading.Event()
        service.arms["049D"].status["power_supply"] = False

        def serve() -> None:
            while not ended.is_set():
                service.wait(0.01)
                service.turn(time.monotonic())

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            settings = [DriverSettings(driver="haply", device="inverse3", settings={"port": service.port, "id": "X"})]
            found = {check.name: check for check in check_host(settings, in_use=False)}
        finally:
            ended.set()
            thread.join()
        assert found["Haply's service"].ok
        assert not found["arm X"].ok
        assert "049D" in found["arm X"].found
        assert found["inverse3 049D"].found == "power no, calibrated yes"
    found = {check.name: check for check in check_host(settings, in_use=False)}
    assert not found["Haply's service"].ok
    assert "start Haply Hub" in found["Haply's service"].advice
