"""The bench of the driver `grasp_odrive_can`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.can.virtual_node import VirtualNode
from tests.gateway.devices.bench import Bench
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(folder: Path) -> Iterator[Bench]:
    """Put an emulated drive on an in-process bus and in the driver's own time."""
    node, bus = VirtualNode(str(folder)), {"interface": "virtual", "channel": str(folder)}
    settings = DriverSettings(driver="grasp_odrive_can", device="grasp_odrive", settings={"bus": bus})
    try:
        yield Bench(settings, output=lambda _: abs(node.drive.applied_nm), clock=node.clock)
    finally:
        node.close()
