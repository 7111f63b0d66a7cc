"""Haply's Inverse3 or Minverse, with a VerseGrip for the roll, through the vendor's local service; see `haply`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from pydantic import Field

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.asked_arm import AskedArm, Link
from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.haply import host_checks
from trocar.services.gateway.haply.opening import DEFAULT_PORT, Wanted, open_arm
from trocar.services.runtime.config import config
from trocar.services.runtime.config.bounds import between
from trocar.services.runtime.config.rig import DriverSettings, Settings

_PORT = between(1, 65535, "", "TCP has no other ports")
_SHARE = between(0.0, 1.0, "", "an arm bears none to all of its weight")
_GAIN = between(0.0, 1.0, "", "the service's own is 0.3")
_DAMPING = between(0.0, 20.0, "N s/m", "more would hide all forces")


class HaplySettings(Settings):
    """Settings in the rig file: the arm, its grip, and what the service adds to forces."""

    id: str | None = Field(None, description="`device_id` of the arm; none: the only one")
    grip: str | None = Field(None, description="`device_id` of the grip that turns the tool; none: the only one")
    roll_axis: Literal["x", "y", "z"] = Field(
        "z", description="axis of the grip about which it turns the tool (assumed)"
    )
    host: str = Field("localhost", description="where the service runs")
    port: Annotated[int, _PORT] = DEFAULT_PORT
    gravity_compensation: Annotated[float, _SHARE] = Field(1.0, description="share of its weight that the arm bears")
    damping_n_s_m: Annotated[float, _DAMPING] = Field(0.0, description="damping that the service adds")
    force_gate: Annotated[float, _GAIN] = Field(0.3, description="gain of the service's filter against oscillation")


class Driver(AskedArm):
    """One arm, by a session of its own."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        own = driver.read_settings(HaplySettings, settings, place)
        file = driver.read_device_file(ArmFile, settings, place)
        super().__init__(file, place, "the arm" if own.id is None else f"the arm {own.id!r}")
        self._wanted = Wanted(
            own.host,
            own.port,
            own.id,
            own.grip,
            own.roll_axis,
            file.model,
            file.device_centre_m,
            own.gravity_compensation,
            own.damping_n_s_m,
            own.force_gate,
        )

    def connect(self) -> Link:
        """Begin a session with the service."""
        return open_arm(self._wanted, self.where, self.shown, self._clock)


def check_host(settings: Sequence[DriverSettings], in_use: bool) -> Iterator[HostCheck]:
    """Check the service and its arms, in use or not: a look at its inventory disturbs no session."""
    own = [config.build(HaplySettings, each.settings, "driver 'haply'") for each in settings]
    for host, port in dict.fromkeys((each.host, each.port) for each in own):
        arms = [each.id for each in own if (each.host, each.port) == (host, port)]
        yield from host_checks.check(host, port, arms)
