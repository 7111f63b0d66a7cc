"""A gateway process on the real bus, a fake haptics beside it, and everything that the gateway said."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.gateway.kicks import kicks_n
from trocar.protocol import Frame
from trocar.protocol.bodies import SupervisorState
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config

RATE_LIMIT_N_S = 200.0
FORCE_N = 1.0
START_TIMEOUT_S = 400.0  # compiling every kernel on a busy machine

#: Friction as large as a file may name: a force that no hand has paid for is not bounded by less (`energy_bound`).
_DEVICE = """
kind: arm
model: an arm in hands that rest
max_force_n: 8.5
continuous_force_n: 3.0
max_velocity_m_s: 1.2
count_m: 3.0e-5
friction_n: 2.0
sure_friction: 1.0
"""


class Bench:
    """Processes of one test, ended with it."""

    def __init__(
        self, folder: Path, grasp: dict[str, Any] | None = None, arms: dict[str, dict[str, Any]] | None = None
    ) -> None:
        self.rig_file = folder / "rig.yaml"
        self.device_file = folder / "device.yaml"
        self.device_file.write_text(_DEVICE)
        instruments = [
            {"name": name, "port_m": [0.06, -0.1, 0.13], "arm": arm} | ({} if grasp is None else {"grasp": grasp})
            for name, arm in (arms or {"left": self.arm("phantom_simulated", hand_stiffness_n_m=300)}).items()
        ]
        rig = {
            "name": "test",
            "transport": {"directory": str(folder)},
            "processes": {"gateway": {"core": 0, "priority": 80}, "haptics": {"core": 0, "priority": 70}},
            "gateway": {
                "instruments": instruments,
                "engage_ramp_s": 0.2,
                "force_rate_limit_n_s": RATE_LIMIT_N_S,
                "supervisor_timeout_s": None,
            },
        }
        self.rig_file.write_text(yaml.safe_dump(rig))
        self.bus = ZmqBus(
            config.load_rig(self.rig_file).transport,
            publishes=["supervisor.state"],
            reads=["gateway.health"],
            reads_every=["gateway.state"],
        )
        self.frames: list[Frame] = []
        self._processes: list[subprocess.Popen[bytes]] = []

    def arm(self, driver: str, **settings: Any) -> dict[str, Any]:
        """Return the rig file's entry of an arm that a force pushes though no hand has pushed before."""
        return {"driver": driver, "device": str(self.device_file), "settings": settings}

    def start(self, module: str, *arguments: str, stdin: int | None = None) -> subprocess.Popen[bytes]:
        process = subprocess.Popen([sys.executable, "-m", module, *arguments], stdin=stdin)
        self._processes.append(process)
        return process

    def gateway(self) -> subprocess.Popen[bytes]:
        return self.start("trocar.services.gateway", "--rig", str(self.rig_file))

    def haptics(self, force_n: float, *period_s: float) -> subprocess.Popen[bytes]:
        return self.start("tests.gateway.fake_haptics", str(self.rig_file), *map(str, (force_n, *period_s)))

    def listen(self, seconds: float) -> list[Frame]:
        """Return the device frames of the next `seconds`."""
        first = len(self.frames)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.frames += self.bus.drain("gateway.state")
            time.sleep(0.01)
        return self.frames[first:]

    def hear(self, frames: int) -> list[Frame]:
        """Return the next so many device frames or more, however long the machine takes for them."""
        first = len(self.frames)
        end = time.monotonic() + START_TIMEOUT_S
        while len(self.frames) < first + frames:
            assert time.monotonic() < end, f"{len(self.frames) - first} of {frames} frames came"
            self.listen(0.01)
        return self.frames[first:]

    def until(self, wanted: Callable[[Any], bool], which: int = 0, since: int | None = None) -> None:
        """Listen until an instrument is as `wanted`, or was in a frame from the one of number `since` on."""
        seen = len(self.frames) if since is None else since
        end = time.monotonic() + START_TIMEOUT_S
        while not any(wanted(frame.body.instruments[which]) for frame in self.frames[seen:]):
            last = self.frames[-1].body.instruments[which] if self.frames else "nothing was heard"
            assert time.monotonic() < end, f"never came to it; last: {last}"
            seen = len(self.frames)
            self.listen(0.05)

    def tell(self, safe_stop: bool, armed: int = 0) -> None:
        """Say what a supervisor would, until it has been heard."""
        while not self.bus.has_reader("supervisor.state"):
            self.listen(0.02)
        self.bus.publish("supervisor.state", SupervisorState(state="running", safe_stop=safe_stop, armed=armed))

    def close(self) -> None:
        for process in self._processes:
            if process.poll() is None:
                os.kill(process.pid, signal.SIGCONT)
                process.kill()
            process.wait()
        self.bus.close()


def active_share(frames: list[Frame], which: int = 0) -> float:
    """Return the share of ticks in which the force of an instrument is active."""
    return float(np.mean([frame.body.instruments[which].state == "active" for frame in frames]))


def forces(frames: list[Frame], which: int = 0) -> np.ndarray:
    return np.array([frame.body.instruments[which].applied_force_n for frame in frames])


def assert_never_a_kick(frames: list[Frame], ttl_s: float = 0.02) -> None:
    """Between neighbouring ticks no rise or turn above the rate; at no age more than can be taken back by the end."""
    ticks = np.array([frame.body.tick for frame in frames])
    written = np.linalg.norm(forces(frames), axis=1)
    # Integers are subtracted: in seconds since the machine was started nine hours are rounded to 7e-12 s, 1.5 nN here.
    passed_s = np.diff([frame.origin_ns for frame in frames]) * 1e-9
    steps = kicks_n(forces(frames))
    neighbours = np.diff(ticks) == 1
    allowed = RATE_LIMIT_N_S * np.minimum(passed_s, 0.003)
    assert neighbours.sum() > 100
    assert (steps[neighbours] <= allowed[neighbours] + 1e-9).all()
    ages_s = np.array([frame.body.instruments[0].model_age_s for frame in frames])
    punctual = np.append(True, passed_s < 0.003)  # a tick that came later found more force than it left
    bound = RATE_LIMIT_N_S * np.maximum(0.0, ttl_s - ages_s)
    known = punctual & (ages_s >= 0.0) & np.append(True, written[:-1] <= bound[:-1] + 1e-9)
    assert known.sum() > 100
    assert (written[known] <= bound[known] + 1e-9).all()


def is_felt(instrument: Any) -> bool:
    """Return whether an arm applies all of `FORCE_N`."""
    return bool(np.linalg.norm(instrument.applied_force_n) > 0.99 * FORCE_N)


def is_out(instrument: Any) -> bool:
    """Return whether an arm is a fault, and limp."""
    return instrument.state == "fault" and not any(instrument.applied_force_n)
