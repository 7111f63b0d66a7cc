"""The bench of the driver `grasp_replay`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench, no_output, write_recording
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(folder: Path) -> Iterator[Bench]:
    """Replay a second of a straight line."""
    file = write_recording(folder, time_s=(0.0, 1.0), handle_angle_rad=(1.0, 0.5))
    yield Bench(DriverSettings(driver="grasp_replay", settings={"file": file}), output=no_output)
