"""The bench of the driver `phantom_simulated`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.gateway.devices.bench import Bench
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """Let the hand follow a stroke: the arm is its own stand-in."""
    settings = DriverSettings(driver="phantom_simulated", device="phantom_premium_1_5", settings={"script": "stroke"})
    yield Bench(settings, output=lambda arm: float(np.linalg.norm(arm.force_n)))
