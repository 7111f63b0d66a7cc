"""What `trocar doctor` says of OpenHaptics and its arms, on hosts made up of files."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from tests.gateway.devices.bench import BenchUnavailable
from tests.gateway.hdapi.hdapi_library import HdapiStandIn
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.hdapi import host_checks

NO_LIBRARY = "libHD-that-nobody-has.so"


def _look(root: Path, names: tuple[str | None, ...] = ("Left",), library: str = NO_LIBRARY) -> dict[str, HostCheck]:
    return {check.name: check for check in host_checks.check(names, library, in_use=False, root=root)}


def _plug_in(root: Path, place: str, vendor: str, product: str, node: str) -> None:
    device = root / "sys/devices" / place
    (device / f"{place}:1.0" / "tty" / node).mkdir(parents=True)
    (device / "idVendor").write_text(f"{vendor}\n")
    (device / "idProduct").write_text(f"{product}\n")
    (device / "product").write_text("Touch\n")
    bus = root / "sys/bus/usb/devices"
    bus.mkdir(parents=True, exist_ok=True)
    (bus / place).symlink_to(device)
    (root / "dev").mkdir(exist_ok=True)
    (root / "dev" / node).touch()


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GTDD_HOME", "/home/surgeon/.3dsystems")


def test_a_host_without_anything_is_told_what_to_install(tmp_path: Path) -> None:
    found = _look(tmp_path)
    assert not found["OpenHaptics"].ok
    assert found["OpenHaptics"].needed
    assert found["OpenHaptics"].found.startswith(f"OpenHaptics cannot be loaded: {NO_LIBRARY}")
    assert "TouchDriver" in found["OpenHaptics"].advice
    assert not found["arms plugged in"].ok
    assert not found["arms' set-up"].ok
    assert "arms' permissions" not in found, "of nothing"
    assert "arm Left" not in found, "without a library nothing is opened"


@pytest.mark.parametrize("ids", [("2988", "0302"), ("2988", "0304"), ("0301", "2988")])
def test_an_arm_on_usb_is_found_with_its_device_file(tmp_path: Path, ids: tuple[str, str]) -> None:
    _plug_in(tmp_path, "1-2", *ids, "ttyACM3")
    _plug_in(tmp_path, "1-3", "046d", "c52b", "ttyACM4")  # somebody else's
    found = _look(tmp_path)
    assert found["arms plugged in"].ok
    assert found["arms plugged in"].found == f"Touch ({ids[0]}:{ids[1]})"
    assert found["arms' permissions"].ok
    assert found["arms' permissions"].found == str(tmp_path / "dev/ttyACM3")


def test_one_arm_where_the_rig_has_two_is_too_few(tmp_path: Path) -> None:
    _plug_in(tmp_path, "1-2", "2988", "0302", "ttyACM0")
    assert not _look(tmp_path, ("Left", "Right"))["arms plugged in"].ok
    _plug_in(tmp_path, "1-4", "2988", "0302", "ttyACM1")
    assert _look(tmp_path, ("Left", "Right"))["arms plugged in"].ok


def test_an_arm_that_this_user_may_not_open_is_named_with_the_rules(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _plug_in(tmp_path, "1-2", "2988", "0302", "ttyACM0")
    monkeypatch.setattr(os, "access", lambda _path, _mode: False)
    check = _look(tmp_path)["arms' permissions"]
    assert not check.ok
    assert "dev/ttyACM0" in check.found
    (rules,) = re.findall(r"\S+\.rules", check.advice)
    assert (Path(__file__).parents[3] / rules).is_file()


def test_a_phantom_on_firewire_is_found(tmp_path: Path) -> None:
    device = tmp_path / "sys/bus/firewire/devices/fw1"
    device.mkdir(parents=True)
    (device / "vendor").write_text("0x000b99\n")
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev/fw1").touch()
    found = _look(tmp_path)
    assert found["arms plugged in"].found == "FireWire (0x000b99)"
    assert found["arms' permissions"].found == str(tmp_path / "dev/fw1")


def test_the_set_up_is_looked_for_by_the_arms_names(tmp_path: Path) -> None:
    folder = tmp_path / "home/surgeon/.3dsystems/config"
    folder.mkdir(parents=True)
    (folder / "Left.config").touch()
    check = _look(tmp_path, ("Left", "Right"))["arms' set-up"]
    assert not check.ok
    assert check.found == f"{folder}: no Right"
    (folder / "Right.config").touch()
    assert _look(tmp_path, ("Left", "Right"))["arms' set-up"].ok


@pytest.mark.parametrize("missing", ["libncurses.so.5", "libPhantomIOLib42.so"])
def test_a_library_that_lacks_another_says_which_package(
    missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = f"OpenHaptics cannot be loaded: {missing}: cannot open shared object file"
    monkeypatch.setattr(host_checks, "_run", lambda *_: (1, said))
    advice = _look(tmp_path, (), "libHD.so")["OpenHaptics"].advice
    assert ("apt install libncurses5" if "ncurses" in missing else "the TouchDriver is missing") in advice


def test_doctor_opens_the_arms_of_the_rig_unless_it_runs(tmp_path: Path) -> None:
    try:
        with HdapiStandIn.compiled(tmp_path) as standin:
            library = str(standin.path)
    except BenchUnavailable as reason:
        pytest.skip(str(reason))
    found = _look(tmp_path, ("Left", "Nobody", None), library)
    assert found["OpenHaptics"].ok
    assert (found["arm Left"].ok, found["arm Left"].found) == (True, "Stand-in, serial number 0001")
    assert not found["arm Nobody"].ok
    assert "device 'Nobody' cannot be opened: HD_DEVICE_FAULT" in found["arm Nobody"].found
    assert found["arm Default Device"].ok
    in_use = {check.name for check in host_checks.check(["Left"], library, in_use=True, root=tmp_path)}
    assert "arm Left" not in in_use


@pytest.mark.parametrize("names", [("Left", "Left"), (None, None), ("Left", "Right", "Left")])
def test_two_instruments_with_one_arm_are_refused_as_the_driver_refuses_them(
    tmp_path: Path, names: tuple[str | None, ...]
) -> None:
    found = _look(tmp_path, names)[f"arm {names[0] or 'Default Device'}"]
    assert (found.ok, found.needed) == (False, True)
    assert found.found == "2 instruments of the rig have this arm, and only one of them can open it"
