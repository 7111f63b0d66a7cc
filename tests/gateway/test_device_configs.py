from __future__ import annotations

import ctypes.util
from pathlib import Path

import pytest

from services.gateway.device_files import DeviceFile
from services.gateway.instrument import build_instruments
from services.runtime import config
from services.runtime.errors import DeviceError

CONFIGS = config.config_directory()


@pytest.mark.parametrize("path", sorted((CONFIGS / "devices").glob("*.yaml")), ids=lambda path: path.stem)
def test_every_device_file_loads(path: Path) -> None:
    config.load(DeviceFile, path)


def test_the_stub_builds_two_instruments_whose_forces_can_be_taken_back_in_time() -> None:
    settings = config.load_rig("stub").gateway
    instruments = build_instruments(settings)
    assert [instrument.name for instrument in instruments] == ["left", "right"]
    # A fresh model is a tick old and lives 20 ms: beyond this the limit could never be reached.
    assert settings.force_limit_n <= settings.force_rate_limit_n_s * (0.020 - 0.001)


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
