"""Emulated drives as the gateway has them: one process for all, reached by nobody else, gone with the last."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.patience import PATIENCE_S
from trocar.services.gateway import drivers
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.drivers import grasp_simulated
from trocar.services.gateway.servo import servo_arrays
from trocar.services.gateway.simulated import drives
from trocar.services.runtime.config.rig import DriverSettings, Mount
from trocar.services.runtime.errors import ConfigError, DeviceError

PLACE = Place("left", Mount(centre_m=(0.04, -0.03, 0.03)))
#: Files of the kernel that list sockets with an address: what anybody may send to.
REACHABLE = ("tcp", "tcp6", "udp", "udp6", "raw", "raw6", "packet")


def _handle(index: int = 0, **settings: object) -> grasp_simulated.Driver:
    chosen = DriverSettings(driver="grasp_simulated", device="grasp_odrive", settings={"recording": "none", **settings})
    handle = drivers.load_grasp(chosen, replace(PLACE, index=index))
    assert isinstance(handle, grasp_simulated.Driver)
    return handle


@contextmanager
def _opened(*handles: grasp_simulated.Driver) -> Iterator[None]:
    with ExitStack() as stack:
        for handle in handles:
            stack.callback(handle.close)
            handle.open()
        yield


def _angles(handle: grasp_simulated.Driver, seconds: float) -> list[float]:
    read, angles = np.zeros(servo_arrays.HANDLE_SIZE), []
    for _ in range(round(seconds / 2e-3)):
        handle.read(time.monotonic_ns(), read)
        angles.append(float(read[servo_arrays.HANDLE_ANGLE]))
        time.sleep(2e-3)
    return angles


def _moves(handle: grasp_simulated.Driver, by_rad: float) -> bool:
    """Read a handle until it has moved; return whether it ever does."""
    angles: list[float] = []
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        angles += _angles(handle, 0.02)
        if np.ptp(angles) > by_rad:
            return True
    return False


def _children() -> set[int]:
    return {int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()}


def test_a_handle_that_is_told_to_go_on_moves_without_torque() -> None:
    handle = _handle()
    with _opened(handle):
        still = _angles(handle, 0.3)
        handle.go_on()
        assert _moves(handle, 0.1)
        assert not handle.ready
    assert np.ptp(still) < 0.01


def test_a_handle_begins_again_where_it_began_and_waits_there_for_its_sign() -> None:
    handle = _handle()
    with _opened(handle):
        began = _angles(handle, 0.1)[-1]
        handle.go_on()
        assert _moves(handle, 0.1)
        handle.begin_again()
        deadline_s = time.monotonic() + PATIENCE_S
        while abs(_angles(handle, 0.02)[-1] - began) > 0.01:
            assert time.monotonic() < deadline_s, "it is not back"
        assert np.ptp(_angles(handle, 0.3)) < 0.01, "nobody has told it to go on"
        handle.go_on()
        assert _moves(handle, 0.1)


def test_a_handle_stands_while_time_does() -> None:
    handle = _handle()
    with _opened(handle):
        handle.go_on()
        assert _moves(handle, 0.1)
        handle.keep_pace(0.0)
        deadline_s = time.monotonic() + PATIENCE_S
        while np.ptp(_angles(handle, 0.3)) > 0.01:
            assert time.monotonic() < deadline_s, "it does not stand"
        handle.keep_pace(1.0)
        assert _moves(handle, 0.1)


def test_all_drives_are_one_process_that_ends_with_the_last() -> None:
    before, handles = _children(), [_handle(0), _handle(1)]
    with _opened(*handles):
        assert len(_children() - before) == 1
        handles[0].close()
        assert len(_children() - before) == 1
        handles[1].go_on()
        assert _moves(handles[1], 0.01), "the other one is still measured"
    assert _children() == before


def test_each_drive_has_its_own_torque() -> None:
    handles = [_handle(0), _handle(1)]
    with _opened(*handles):
        begun_s = time.monotonic()
        armed_s = -np.inf
        while not (handles[1].ready and handles[1].applied_nm() == pytest.approx(0.05)):
            now_s = time.monotonic()
            assert now_s < begun_s + 30.0
            if not handles[1].ready and now_s > armed_s + 2.0:  # the watchdog expired while the test stood still
                handles[1].enable()
                armed_s = now_s
            for handle in handles:
                handle.read(time.monotonic_ns(), np.zeros(servo_arrays.HANDLE_SIZE))
                handle.write(0.05)
            time.sleep(2e-3)
        assert handles[0].applied_nm() == 0.0, "its loop is open"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_drives_that_died_or_hang_are_a_fault_until_the_rig_is_armed(number: signal.Signals) -> None:
    """Both handles come back in one new process, also where the rig is armed as soon as the fault is told."""
    before, handles = _children(), [_handle(0), _handle(1)]
    with _opened(*handles):
        (first,) = _children() - before
        os.kill(first, number)
        _read_until(handles, lambda: all("the grasp drive (node" in handle.fault for handle in handles))
        assert not any(handle.ready for handle in handles)
        for handle in handles:
            handle.clear_fault()
        _read_until(handles, lambda: not any(handle.is_opening or handle.fault for handle in handles))
        (second,) = _children() - before
        assert second != first
        handles[1].go_on()
        assert _moves(handles[1], 0.01)


def test_handles_that_are_opened_at_once_find_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is opened in a thread of its own, and a process takes a while to start on a busy machine."""

    class Slow:
        def __init__(self, core: int | None, priority: int | None) -> None:
            time.sleep(0.2)

        def end(self) -> None: ...

    monkeypatch.setattr(drives, "DriveProcess", Slow)
    monkeypatch.setattr(drives, "_running", {})
    with ThreadPoolExecutor(2) as threads:
        first, second = threads.map(lambda _: drives.find_process(None, None), range(2))
    assert first is second


def _read_until(handles: list[grasp_simulated.Driver], done: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        for handle in handles:
            handle.read(time.monotonic_ns(), np.zeros(servo_arrays.HANDLE_SIZE))
            handle.write(0.0)
        if done():
            return
        assert time.monotonic() < deadline_s, [handle.fault for handle in handles]
        time.sleep(2e-3)


def test_nobody_else_can_reach_a_drive() -> None:
    """No socket of the process has an address, so no other process, of whatever user, can send to it."""
    before = _children()
    with _opened(_handle()):
        (pid,) = _children() - before
        links = [os.readlink(each) for each in Path(f"/proc/{pid}/fd").iterdir()]
        inodes = {link.removeprefix("socket:[").removesuffix("]") for link in links if link.startswith("socket:[")}
        assert len(inodes) == 2, "orders and one bus"
        for name in REACHABLE:
            table = Path(f"/proc/{pid}/net/{name}")
            assert not table.exists() or not inodes & set(table.read_text().split())
        rows = [line.split() for line in Path(f"/proc/{pid}/net/unix").read_text().splitlines()[1:]]
        assert {len(row) for row in rows if row[6] in inodes} == {7}, "an eighth word is the name of a socket"


def test_a_process_that_cannot_start_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drives.sys, "executable", "/bin/false")
    with (
        pytest.raises(DeviceError, match="'left': the process of the emulated drives ended with code 1"),
        _opened(_handle()),
    ):
        pass


def test_a_recording_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.csv"), _opened(_handle(recording=str(tmp_path / "none.csv"))):
        pass


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, "b.csv"),
        ({"recording": "none"}, None),
        ({"recording": "c.csv"}, "c.csv"),
        ({"scenario": "insertion"}, None),
        ({"script": "stroke", "recording": "c.csv"}, "c.csv"),
    ],
)
def test_which_recording_moves_a_handle(
    settings: dict[str, str], expected: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("handle_angle_rad\n1\n")
    monkeypatch.setenv("TROCAR_GRASP_RECORDINGS", str(tmp_path))
    own = grasp_simulated.SimulatedGraspSettings(**settings)  # type: ignore[arg-type]
    found = grasp_simulated.find_recording(own, 1)
    assert (Path(found).name if found else None) == expected


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_what_ends_a_rig_ends_the_drives_with_the_gateway_and_not_before(number: signal.Signals) -> None:
    """A service's stop reaches all processes at once: the drives were gone first, and that was an alarm."""
    handle = _handle()
    with _opened(handle):
        (process,) = drives._running.values()
        os.kill(process._process.pid, number)
        handle.go_on()
        assert _moves(handle, 1e-3)
        assert handle.fault == ""
    assert process.end() == 0
