"""Checks of ``trocar doctor``: how late forces are assumed to come, and how late they do in a rig that runs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any

from trocar.protocol.topics import TICK_S
from trocar.services.cli.host_checks import CheckResult, finding
from trocar.services.gateway.devices.device_files import ArmFile, DeviceFile, GraspFile, GripperFile
from trocar.services.gateway.instruments.instrument import WRITE_SPAN
from trocar.services.gateway.servo.servo_arrays import FLIGHTS
from trocar.services.runtime.bus.endpoints import lock_holders
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import DriverSettings, Rig
from trocar.services.runtime.errors import BusError, ConfigError

_HEALTH = "gateway.health"
_ANY_DEVICE: Any = DeviceFile  # a union, which is no class
#: Health comes ten times a second.
_PATIENCE_S, _TURN_S = 1.0, 0.05


def delays(rig: Rig) -> Iterator[CheckResult]:
    """Yield for every device with a file the delay and friction that it tells, and the delay that is measured."""
    spans = _measured_spans(rig)
    for row in rig.gateway.instruments:
        for kind, settings in (("arm", row.arm), ("grasp", row.grasp)):
            file = _file_of(settings)
            if file is not None:
                yield delay(f"{row.name} {kind}", file, spans.get(f"{WRITE_SPAN}.{row.name}.{kind}"))


def delay(name: str, file: ArmFile | GraspFile | GripperFile, span_s: float | None) -> CheckResult:
    """Return the finding on one device, whose longest time from reading to writing is `span_s` if a rig runs."""
    unit, friction = ("N", file.friction_n) if isinstance(file, ArmFile) else ("N m", file.friction_nm)
    told_s = file.interface_delay_s
    measured = "not measured, as no rig runs" if span_s is None else f"measured {1e3 * span_s:.3f} ms beside it"
    found = (
        f"interface assumed to take at most {1e3 * told_s:g} ms, {measured}; friction of "
        f"{file.sure_friction * friction:g} {unit} relied on, {file.sure_friction:.0%} of {friction:g} {unit}"
    )
    most_s = FLIGHTS * TICK_S
    advice = (
        f"forces that come later than {1e3 * most_s:g} ms in all fade: see real-time settings above, end other load"
    )
    return finding(f"delay of {name}", told_s + (span_s or 0.0) <= most_s, found, advice)


def _file_of(settings: DriverSettings | None) -> ArmFile | GraspFile | GripperFile | None:
    """Return a device's file; None if it has none, or one that `validate` has told of."""
    if settings is None or settings.device is None:
        return None
    try:
        file: ArmFile | GraspFile | GripperFile = config.load(_ANY_DEVICE, config.find("device", settings.device))[0]
    except ConfigError:
        return None
    return file


def _measured_spans(rig: Rig) -> Mapping[str, float]:
    """Return the gauges of the gateway of a rig that runs on this transport, none without one."""
    if not lock_holders(rig.transport):
        return {}
    try:
        bus = ZmqBus(rig.transport, reads=[_HEALTH])
    except BusError:
        return {}
    try:
        until_s = time.monotonic() + _PATIENCE_S
        while time.monotonic() < until_s:
            frame = bus.latest(_HEALTH)
            if frame is not None:
                gauges: Mapping[str, float] = frame.body.gauges
                return gauges
            time.sleep(_TURN_S)
    finally:
        bus.close()
    return {}
