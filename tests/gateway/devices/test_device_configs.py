from __future__ import annotations

import ctypes.util
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.refusals import assert_refused
from trocar.services.gateway.devices.device_files import ArmFile, DeviceFile
from trocar.services.gateway.instruments import instrument as instrument_module
from trocar.services.gateway.instruments.instrument import build_instruments
from trocar.services.gateway.servo import servo_arrays
from trocar.services.gateway.simulated import premium_model
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError, DeviceError

CONFIGS = config.config_directory()


@pytest.mark.parametrize("path", sorted((CONFIGS / "devices").glob("*.yaml")), ids=lambda path: path.stem)
def test_of_every_device_file_each_key_is_taken_as_it_stands(path: Path) -> None:
    said: dict[str, Any] = yaml.safe_load(path.read_text())
    loaded = config.load(DeviceFile, path)[0]
    taken = {key: getattr(loaded, key) for key in said}
    assert {key: list(value) if isinstance(value, tuple) else value for key, value in taken.items()} == said


def test_the_simulated_premium_has_the_count_and_friction_of_its_device_file() -> None:
    file = config.load(ArmFile, CONFIGS / "devices" / "phantom_premium_1_5.yaml")[0]
    assert (file.count_m, file.friction_n) == (premium_model.COUNT_M, premium_model.FRICTION_N)
    assert file.limits().friction_n == file.sure_friction * file.friction_n < file.friction_n


def _changed(device: str, **changes: str | None) -> str:
    """Return the text of a device file with other values of some keys, or without them."""
    lines = (CONFIGS / "devices" / f"{device}.yaml").read_text(encoding="utf-8").splitlines()
    others = [line for line in lines if line.partition(":")[0] not in changes]
    return "\n".join([*others, *(f"{key}: {value}" for key, value in changes.items() if value is not None)])


#: The file's text, and a pattern of the sentence.
REFUSED = [
    *(
        (_changed(device, **{key: value}), said)
        for device in ("touch", "grasp_odrive")
        for key, value, said in (
            ("interface_delay_s", "1.0", r"interface_delay_s: 1 s is more than 0\.003 s: a force that comes later"),
            ("interface_delay_s", "-1.0e-4", r"interface_delay_s: -0\.0001 s is less than 0 s"),
            ("sure_friction", "25", r"sure_friction: 25 is more than 1: an arm has"),
        )
    ),
    (_changed("touch", count_m="0.055"), r"count_m: 0\.055 m is more than 0\.0002 m: no encoder"),  # a count in mm
    (_changed("touch", count_m="0"), r"count_m: 0 m is less than 1e-08 m: no encoder"),
    (_changed("touch", count_m=".nan"), r"count_m"),
    (_changed("touch", count_m=None), r"count_m"),
    (_changed("touch", friction_n="0"), r"friction_n: 0 N is less than 0\.0001 N: every arm"),
    (_changed("touch", friction_n="26"), r"friction_n: 26 N is more than 2 N: every arm"),
    (_changed("touch", friction_n="much"), r"friction_n.*number"),
    (_changed("touch", max_force_n="1.0e+6"), r"max_force_n: 1e\+06 N is more than 50 N: the strongest"),
    (_changed("touch", max_velocity_m_s="1.0e+6"), r"max_velocity_m_s: 1e\+06 m/s is more than 100 m/s: no hand"),
    (
        _changed("touch", openhaptics_centre_m="[1.0e+9, 0, 0]"),
        r"openhaptics_centre_m\.0: 1e\+09 m is more than 1 m: the workspace",
    ),
    # Of a file that may be several things, the kind decides which keys there are.
    ("model: x", r"^.*mine\.yaml: kind: this key is missing"),
    ("kidn: arm\nmodel: x", r"kidn: unknown key 'kidn'; known: "),
    (
        "kind: arm\nmodle: x",
        r"arm\.modle: unknown key 'modle'; known: continuous_force_n, count_m, device_centre_m, friction_n",
    ),
]


@pytest.mark.parametrize(("text", "sentence"), REFUSED)
def test_a_mistake_in_a_device_file_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    assert_refused(lambda file: config.load(DeviceFile, file), tmp_path / "mine.yaml", text, sentence)


def test_the_stub_builds_two_instruments_whose_forces_can_be_taken_back_in_time() -> None:
    settings = config.load_rig("stub").gateway
    instruments = build_instruments(settings)
    assert [instrument.name for instrument in instruments] == ["left", "right"]
    # A fresh model is a tick old and lives 20 ms: beyond this the limit could never be reached.
    assert settings.force_limit_n <= settings.force_rate_limit_n_s * (0.020 - 0.001)


def test_a_handles_driver_is_told_the_torque_rate_of_its_instruments_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is told less would give another torque than the law has in its books."""
    told: list[float] = []
    monkeypatch.setattr(instrument_module, "load_grasp", lambda _, place: told.append(place.torque_rate_nm_s))
    built = build_instruments(config.load_rig("stub").gateway)
    packed = [float(each.servo.limits.pack()[servo_arrays.LIMIT_TORQUE_RATE]) for each in built]
    assert told == packed == [20.0, 20.0]  # 0.3 N m in the 15 ms that 3 N take at 200 N/s


def test_stub_and_hardware_differ_in_their_gateway_section_only() -> None:
    stub, hardware = (config.load_rig(name).model_dump() for name in ("stub", "hardware"))
    differing = {key for key in stub if stub[key] != hardware[key]}
    assert differing == {"name", "base", "gateway"}


def test_hardware_without_the_vendors_library_is_one_sentence() -> None:
    instruments = build_instruments(config.load_rig("hardware").gateway)
    assert [instrument.arm.limits.max_force_n for instrument in instruments] == [8.5, 8.5]
    if ctypes.util.find_library("HD") is not None:
        pytest.skip("OpenHaptics is installed here")
    with pytest.raises(
        DeviceError, match=r"instrument 'left': OpenHaptics cannot be loaded: libHD\.so: .*`trocar doctor"
    ):
        instruments[0].open()


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("max_torque_nm", r"1e\+06 N m is more than 5 N m: the servo gives"),
        ("max_motor_current_a", r"1e\+06 A is more than 40 A: an ODrive S1"),
        ("max_motor_turns_s", r"1e\+06 turns/s is more than 1000 turns/s: no motor"),
        ("motor_turns_per_handle_turn", r"1e\+06 is more than 1000: a handle's gear"),
        ("watchdog_s", r"1e\+06 s is more than 0\.5 s: a drive pulls"),
        ("heartbeat_timeout_s", r"1e\+06 s is more than 1 s: a drive that is silent"),
    ],
)
def test_a_handle_that_no_drive_moves_is_refused_with_unit_and_reason(key: str, said: str) -> None:
    with pytest.raises(ConfigError, match=rf"{key}: {said}"):
        config.load(DeviceFile, CONFIGS / "devices" / "grasp_odrive.yaml", [f"{key}=1.0e+6"])
