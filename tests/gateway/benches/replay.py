"""The bench of the driver `replay`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench, no_output, write_recording
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(folder: Path) -> Iterator[Bench]:
    """Replay a second of a straight line."""
    file = write_recording(
        folder, time_s=(0.0, 1.0), x_m=(0.0, 0.01), y_m=(0.0, 0.0), z_m=(0.0, 0.0), roll_rad=(0.0, 0.1)
    )
    yield Bench(DriverSettings(driver="replay", settings={"file": file}), output=no_output)
