"""Emulated drives on a bus of one's own, to try the CAN settings of a rig file without a drive, until Ctrl-C.

``python -m tests.gateway.can.drives_to_try PORT`` is an adapter on a serial line (slcan): a link named PORT to a pseudo
terminal. ``python -m tests.gateway.can.drives_to_try '{interface: socketcan, channel: vcan0}'`` uses an existing bus.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from pathlib import Path

import can
import yaml

from tests.gateway.can.slcan_adapter import Adapter
from tests.gateway.can.virtual_node import VirtualNode
from trocar.services.gateway.can import canbus, cansimple

NODES = (1, 2)
_TICK_S = 1e-3
#: What drives say themselves: some buses give it back to whoever sent it.
_OF_DRIVES = (cansimple.HEARTBEAT, cansimple.GET_ENCODER_ESTIMATES, cansimple.GET_VERSION)
_WIRES = "the wires behind the adapter"


class LiveAdapter(Adapter):
    """Never waits for whoever reads the port: what is not taken is lost, as on a bus."""

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._own, data)


def open_outside(where: str) -> can.BusABC:
    """Return the bus on which drives are to be heard."""
    settings = yaml.safe_load(where)
    if isinstance(settings, dict):
        return canbus.open_bus(settings, "drives to try")
    adapter, port = LiveAdapter(), Path(where)
    port.unlink(missing_ok=True)
    port.symlink_to(adapter.port_name)
    return adapter


def main(where: str) -> None:
    outside, wires = open_outside(where), can.Bus(interface="virtual", channel=_WIRES)
    nodes = [VirtualNode(_WIRES, node) for node in NODES]
    print(f"drives {', '.join(map(str, NODES))} are on {where}")
    due_s = time.monotonic()
    while True:
        for node in nodes:
            node.advance()
        while message := wires.recv(0.0):
            with contextlib.suppress(can.CanError):  # nobody listens
                outside.send(message)
        for message in canbus.drain(outside):
            if message.is_remote_frame or cansimple.command(message.arbitration_id) not in _OF_DRIVES:
                wires.send(message)
        due_s = max(due_s + _TICK_S, time.monotonic() - 0.05)
        time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main(sys.argv[1])
