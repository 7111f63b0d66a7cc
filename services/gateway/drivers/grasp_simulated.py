"""A simulated handle: an emulated drive on a real CAN bus in its own process, spoken to as a real one is."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Annotated, Any

import can
import msgspec
from pydantic import Field

from services.gateway import canbus, cansimple, driver
from services.gateway.bench import REAL_TIME, Bench, BenchUnavailable
from services.gateway.cansimple import AxisState
from services.gateway.device_files import GraspFile
from services.gateway.drive_node import Task
from services.gateway.driver import Place
from services.gateway.drivers.grasp_odrive_can import OdriveGrasp
from services.runtime.errors import DeviceError
from services.runtime.rig import DriverSettings, Settings

_REPOSITORY = Path(__file__).resolve().parents[3]
_STOP_TIMEOUT_S = 2.0


class SimulatedGraspSettings(Settings):
    """Of the rig file: what moves the handle, and where its process runs."""

    recording: str = Field(
        "auto", description="a 1 kHz csv, auto or none; auto: one that is there where nothing else is named"
    )
    script: str | None = Field(None, description="a file of configs/scripts: its handle angles")
    scenario: str | None = Field(None, description="a scenario of the mechanics: its handle angles")
    pace: Annotated[float, Field(gt=0.0)] = Field(1.0, description="of script or scenario; 0.5 takes twice as long")
    range_rad: tuple[float, float] | None = Field(
        None, description="angles that shut and open (0 and 1 rad) of the motion become, e.g. round a duct"
    )
    bus: dict[str, Any] | None = Field(None, description="python-can's own settings; by default a private multicast")
    core: Annotated[int, Field(ge=0)] | None = None
    priority: Annotated[int, Field(ge=1, le=89)] | None = None


class Driver(OdriveGrasp):
    """Spawns the node, then is an ordinary ODrive handle."""

    #: A process takes a while to start on a busy machine.
    found_timeout_s = 60.0

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        own = driver.read_settings(SimulatedGraspSettings, settings, place)
        file = driver.read_device_file(GraspFile, settings, place)
        bus = own.bus or private_bus()
        node = place.index + 1
        super().__init__(file, bus, node, place)
        self.task = Task(
            bus=bus,
            node=node,
            watchdog_s=file.watchdog_s,
            instrument=place.instrument,
            index=place.index,
            recording=find_recording(own, place.index),
            script=own.script,
            scenario=own.scenario,
            pace=own.pace,
            range_rad=own.range_rad,
            core=own.core,
            priority=own.priority,
        )
        self.process: subprocess.Popen[bytes] | None = None
        self._goes_on = False

    def open(self) -> None:
        """Start the node and find it on its bus."""
        command = [sys.executable, "-m", "services.gateway.drive_node", msgspec.json.encode(self.task).decode()]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True)
        try:
            super().open()
        except DeviceError:
            if self.may_come():
                raise
            raise DeviceError(f"{self._where}: the emulated drive ended with code {self.process.returncode}") from None

    def go_on(self) -> None:
        """Let the hand on the handle begin without torque."""
        if self.process is not None and not self._goes_on:
            self._goes_on = True
            self.process.send_signal(signal.SIGUSR1)

    def may_come(self) -> bool:
        """Return whether the node's process lives."""
        return self.process is not None and self.process.poll() is None

    def close(self) -> None:
        """End the node after the drive was let go."""
        try:
            super().close()
        finally:
            process, self.process = self.process, None
            if process is not None and process.stdin is not None:
                process.stdin.close()
                try:
                    process.wait(_STOP_TIMEOUT_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


class Listener:
    """Somebody else on the bus of a node, who hears what torque it is told."""

    def __init__(self, bus: can.BusABC, node: int) -> None:
        self._bus = bus
        self._node = node
        self._torque_nm = 0.0
        self._closed_loop = False

    def torque_nm(self) -> float:
        """Return the newest torque that the node was told, 0 unless it has said that its loop is closed."""
        for message in canbus.drain(self._bus):
            if message.arbitration_id == cansimple.identifier(self._node, cansimple.SET_INPUT_TORQUE):
                self._torque_nm = cansimple.unpack_float(bytes(message.data))
            elif message.arbitration_id == cansimple.identifier(self._node, cansimple.HEARTBEAT):
                self._closed_loop = cansimple.unpack_heartbeat(bytes(message.data))[1] == AxisState.CLOSED_LOOP
        return self._torque_nm if self._closed_loop else 0.0


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """Listen on the bus of the node that the driver starts."""
    bus = private_bus()
    try:
        overheard = canbus.open_bus(bus, "bench")
    except DeviceError as error:
        raise BenchUnavailable(str(error)) from None
    listener = Listener(overheard, 1)
    settings = DriverSettings(
        driver="grasp_simulated", device="grasp_odrive", settings={"recording": "none", "bus": bus}
    )
    try:
        yield Bench(settings, output=lambda _: abs(listener.torque_nm()), clock=REAL_TIME)
    finally:
        overheard.shutdown()


def private_bus() -> dict[str, Any]:
    """Return settings of a CAN bus that only this host can see: multicast that takes no hop, on a free port."""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    return {"interface": "udp_multicast", "channel": "239.74.163.2", "port": port, "hop_limit": 0, "fd": False}


def find_recording(settings: SimulatedGraspSettings, index: int) -> str | None:
    """Return the recording for the instrument of that number, or None.

    ``auto`` takes them from ``$TROCAR_GRASP_RECORDINGS``, else from the folder of recordings beside the repository,
    unless a script or a scenario is named.
    """
    if settings.recording != "auto":
        return None if settings.recording == "none" else settings.recording
    if settings.script is not None or settings.scenario is not None:
        return None
    folder = Path(os.environ.get("TROCAR_GRASP_RECORDINGS") or _REPOSITORY.parent / "shared" / "data" / "grasp")
    found = sorted(folder.glob("*.csv"))
    return str(found[index % len(found)]) if found else None
