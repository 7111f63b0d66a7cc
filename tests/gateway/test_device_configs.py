from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import TypeAdapter

from services.gateway.device_files import DeviceFile
from services.gateway.instrument import build_instruments
from services.runtime import config
from services.runtime.errors import DeviceError

CONFIGS = config.config_directory()


@pytest.mark.parametrize("path", sorted((CONFIGS / "devices").glob("*.yaml")), ids=lambda path: path.stem)
def test_every_device_file_loads(path: Path) -> None:
    TypeAdapter(DeviceFile).validate_python(config.read_yaml(path))


def test_the_stub_builds_two_instruments_whose_forces_can_be_taken_back_in_time() -> None:
    settings = config.load_rig("stub").gateway
    instruments = build_instruments(settings)
    assert [instrument.name for instrument in instruments] == ["left", "right"]
    # A fresh model is a tick old and lives 20 ms: beyond this the limit could never be reached.
    assert settings.force_limit_n <= settings.force_rate_limit_n_s * (0.020 - 0.001)


def test_stub_and_hardware_differ_in_their_gateway_section_only() -> None:
    stub, hardware = (config.load_rig(name).model_dump() for name in ("stub", "hardware"))
    differing = {key for key in stub if stub[key] != hardware[key]}
    assert differing == {"name", "gateway"}


def test_hardware_without_its_driver_is_one_sentence() -> None:
    if (Path(config.__file__).parents[1] / "gateway" / "drivers" / "phantom_hdapi.py").exists():
        pytest.skip("the driver is there")
    with pytest.raises(DeviceError, match="instrument 'left': there is no driver 'phantom_hdapi'; known:"):
        build_instruments(config.load_rig("hardware").gateway)
