"""The insertion in a rig of its own, whose every frame is kept: what `trocar haptics --running` looks at."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trocar.protocol.bodies import GatewayState, PhysicsState
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.errors import UserError
from trocar.studies.feel.tracking import is_inserted

#: Jaws hold the duct in it: where they slip, how far hangs on rounding, and no two runs are alike.
SCENE = "default"
#: Hands move at this share of the scene's speed: a machine that loses ticks loses less of the way.
PACE = 0.5
_STARTS_S, _INSERTS_S, _ENDS_S, _LOOK_S = 300.0, 60.0, 20.0, 0.005


def run_insertion(directory: Path) -> tuple[list[GatewayState], list[PhysicsState]]:
    """Run the rig in `directory`, which is empty, until 20 mm are in; return all that gateway and physics said.

    Raises UserError if the rig does not come up, or the catheter does not go in.
    """
    with _rig(directory) as (process, bus):
        said: list[GatewayState] = []
        solved: list[PhysicsState] = []
        until = time.monotonic() + _STARTS_S
        while not is_inserted(solved):
            if process.poll() is not None or time.monotonic() > until:
                last = " ".join((directory / "log").read_text(errors="replace").splitlines()[-1:])
                raise UserError(f"the rig did not {'insert 20 mm' if solved else 'come up'} in time: {last}")
            time.sleep(_LOOK_S)
            said += [frame.body for frame in bus.drain("gateway.state")]
            begun = bool(solved)
            solved += [frame.body for frame in bus.drain("physics.state")]
            if solved and not begun:
                until = time.monotonic() + _INSERTS_S
        return said, solved


@contextmanager
def _rig(directory: Path) -> Iterator[tuple[subprocess.Popen[bytes], ZmqBus]]:
    transport = Transport(directory=directory / "bus")
    log = (directory / "log").open("wb")
    process = subprocess.Popen(
        [sys.executable, "-m", "trocar.services.supervisor", "--rig", "stub", "--scene", SCENE, *_options(directory)],
        stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    bus = ZmqBus(transport, reads_every=["gateway.state", "physics.state"])
    try:
        yield process, bus
    finally:
        process.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_ENDS_S)
        process.kill()
        process.wait()
        bus.close()
        log.close()


def _options(directory: Path) -> Iterator[str]:
    hand = f"{{script: scene, pace: {PACE}}}"
    settings = [f"gateway.instruments.{k}.{device}.settings={hand}" for k in (0, 1) for device in ("arm", "grasp")]
    settings += [f"contracts.loops.{loop}.stop_miss_ratio=1" for loop in ("gateway", "haptics", "physics")]
    settings += [
        f"transport.directory={directory / 'bus'}",
        f"recorder.directory={directory / 'recordings'}",
        f"supervisor.web.port={_free_port()}",
        "visualization.viewer=none",
        "processes.visualization.enabled=false",
    ]
    for setting in settings:
        yield from ("--set", setting)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
