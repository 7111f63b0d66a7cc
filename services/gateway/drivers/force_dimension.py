"""An arm of Force Dimension, or Novint's Falcon, through the vendor's DHD; see `dhd`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.asked_arm import ArmAnswer, ArmConnection, AskedArm
from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.devices.grip_roll import GripRoll
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.dhd import host_checks
from trocar.services.gateway.dhd.server import DeviceServer, as_answer, join_server, leave_server
from trocar.services.gateway.dhd.settings import DhdSettings
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import DriverSettings, Vector3
from trocar.services.runtime.errors import DeviceError

_PART = "arm"
_FAMILIES = ("omega", "sigma", "delta", "lambda", "falcon")


class DeviceLink(ArmConnection):
    """The arm of a device that is served."""

    def __init__(self, server: DeviceServer, own: DhdSettings, centre_m: Vector3, shown: str) -> None:
        self._server, self._own, self._centre_m, self._shown = server, own, centre_m, shown
        self._roll = GripRoll()
        self._closed = False

    @property
    def outstanding(self) -> int:
        """How many exchanges have not ended."""
        return self._server.asked - self._server.answered

    @property
    def lost(self) -> str:
        """Why there will be no more answers."""
        return f"{self._shown} {self._server.lost}" if self._server.lost else ""

    def switch_on(self) -> None:
        """Switch the motors on."""
        self._server.switch_on()

    def ask_state(self, force_n: Vector3, now_ns: int) -> None:
        """Ask for an exchange; the library's axes are those of an arm: toward the user, right, up."""
        self._server.ask_state(force_n, now_ns)

    def answers(self, now_ns: int) -> list[ArmAnswer]:
        """Return what exchanges have told."""
        found = []
        while self._server.answers:
            asked_ns, sample = self._server.answers.popleft()
            if sample.turn_rad is not None:
                self._roll.take_turn(sample.turn_rad, asked_ns)
            found.append(as_answer(asked_ns, sample, self._roll.roll_rad, self._shown, self._centre_m))
        return found

    def close(self) -> None:
        """Let the device go, unless its gripper is used."""
        if not self._closed:
            leave_server(self._own.library, self._own.serial, _PART)
        self._closed = True


class Driver(AskedArm):
    """One arm, whose device may have a gripper: see `grasp_force_dimension`."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._own = own = driver.read_settings(DhdSettings, settings, place)
        self._file = file = driver.read_device_file(ArmFile, settings, place)
        super().__init__(file, place, "the arm" if own.serial is None else f"the arm {own.serial}")

    def connect(self) -> ArmConnection:
        """Open the device, unless its gripper has it open."""
        own = self._own
        server = join_server(own.library, own.serial, own.gravity_compensation, _PART, self.where, self._clock)
        told, found = _family(self._file.model), _family(server.model)
        if told and found and told != found:
            leave_server(own.library, own.serial, _PART)
            raise DeviceError(
                f"{self.where}: {self.shown} is a {server.model}, its device file is of {self._file.model}: "
                "name the file of this arm as `device`"
            )
        return DeviceLink(server, own, self._file.device_centre_m, self.shown)


def _family(model: str) -> str:
    """Return the series of a model, whose arms bear the same; empty if it is none of the known."""
    return next((name for name in _FAMILIES if name in model.lower()), "")


def check_host(settings: Sequence[DriverSettings], in_use: bool) -> Iterator[HostCheck]:
    """Check library, arms and permissions."""
    own = [config.build(DhdSettings, each.settings, "driver 'force_dimension'") for each in settings]
    for library in dict.fromkeys(each.library for each in own):
        yield from host_checks.check(library, [each.serial for each in own if each.library == library], in_use)
