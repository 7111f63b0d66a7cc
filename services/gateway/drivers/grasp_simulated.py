"""A simulated handle: an emulated drive in a process of its own, reached over a CAN bus like a real one."""

from __future__ import annotations

import os
from pathlib import Path

import can
from pydantic import Field

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.device_files import GraspFile
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.drivers.grasp_odrive_can import OdriveGrasp
from trocar.services.gateway.motions.script import SCENE
from trocar.services.gateway.simulated import drives, hand_motion
from trocar.services.gateway.simulated.drive_orders import BeginAgain, GoOn, SetPace
from trocar.services.gateway.simulated.hand_motion import HandMotion
from trocar.services.runtime.config.bounds import Core, Pace, Priority, Turn
from trocar.services.runtime.config.rig import DriverSettings, Settings
from trocar.services.runtime.errors import DeviceError

_REPOSITORY = Path(__file__).resolve().parents[3]


class SimulatedGraspSettings(Settings):
    """Settings in the rig file: the handle's motion, and core and priority of the emulated drives' process."""

    recording: str = Field(
        "auto", description="a 1 kHz csv, auto or none; auto: one that is there where nothing else is named"
    )
    script: str | None = Field(
        None, description="a file of configs/scripts, or `scene`: the handle angles of what the scene is for"
    )
    scenario: str | None = Field(None, description="a scenario of the mechanics: its handle angles")
    pace: Pace = Field(1.0, description="speed of the script; 0.5 takes twice as long")
    range_rad: tuple[Turn, Turn] | None = Field(
        None, description="angles that shut and open (0 and 1 rad) of the motion become, e.g. round a duct"
    )
    core: Core | None = None
    priority: Priority | None = None


class Driver(OdriveGrasp):
    """Starts an emulated drive, and uses it like any ODrive handle."""

    #: A process takes a while to start on a busy machine.
    found_timeout_s = 60.0
    reopens = True

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._own = driver.read_settings(SimulatedGraspSettings, settings, place)
        super().__init__(driver.read_device_file(GraspFile, settings, place), place.index + 1, place)
        self._place = place
        self._drives: drives.DriveProcess | None = None
        self._goes_on = False

    def open_bus(self) -> can.BusABC:
        """Start the drive and return its bus."""
        if self._drives is not None:  # reopened: the process is dead, or hangs
            self._drives.kill()
        self._drives = drives.find_process(self._own.core, self._own.priority)
        return self._drives.join(self.node, self.file.watchdog_s, choose_motion(self._own, self._place))

    def open(self) -> None:
        """Start the drive and find it on its bus."""
        try:
            super().open()
        except DeviceError:
            code = self._drives.end() if self._drives is not None else None
            if code is None:
                raise
            raise DeviceError(f"{self.where}: the process of the emulated drives ended with code {code}") from None

    def go_on(self) -> None:
        """Start the hand's motion without torque."""
        if self._drives is not None and not self._goes_on:
            self._goes_on = True
            self._drives.order(GoOn(self.node))

    def begin_again(self) -> None:
        """Restart the hand's motion, with the torque or by `go_on`."""
        self._goes_on = False
        if self._drives is not None:
            self._drives.order(BeginAgain(self.node))

    def keep_pace(self, pace: float) -> None:
        """Set the pace of the hand's motion."""
        if self._drives is not None:
            self._drives.order(SetPace(self.node, pace))

    def may_come(self) -> bool:
        """Return whether the drive's process is running."""
        return self._drives is not None and self._drives.end() is None

    def applied_nm(self) -> float:
        """Return the torque on the handle according to the drive, 0 without one."""
        return self._drives.applied_nm(self.node) if self._drives is not None else 0.0

    def close(self) -> None:
        """Disarm the drive, then end it."""
        try:
            super().close()
        finally:
            process, self._drives = self._drives, None
            if process is not None:
                process.leave(self.node)


def choose_motion(settings: SimulatedGraspSettings, place: Place) -> HandMotion:
    """Return the motion of the hand on the handle: a recording, a scenario, a script, or a squeeze."""
    motion = _choose(settings, place)
    return motion if settings.range_rad is None else hand_motion.fitted(motion, settings.range_rad)


def _choose(settings: SimulatedGraspSettings, place: Place) -> HandMotion:
    recording = find_recording(settings, place.index)
    if recording is not None:
        return hand_motion.recorded(Path(recording))
    if settings.scenario is not None:
        return hand_motion.of_scenario(settings.scenario, place.index, settings.pace)
    if settings.script == SCENE and place.motion is not None:
        return hand_motion.of_motion(place.motion, settings.pace)
    if settings.script not in (None, SCENE):
        return hand_motion.scripted(settings.script, place.instrument, settings.pace)
    return hand_motion.squeeze()


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
