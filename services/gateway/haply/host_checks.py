"""Checks of Haply's service on this host, for ``trocar doctor``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trocar.services.gateway.devices.clock import REAL_TIME
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.haply.messages import Told
from trocar.services.gateway.haply.opening import list_devices
from trocar.services.runtime.errors import DeviceError


def check(host: str, port: int, arms: Sequence[str | None]) -> Iterator[HostCheck]:
    """Yield whether the service answers, and the state of each arm; a look at the inventory disturbs no session."""
    try:
        told = list_devices(host, port, REAL_TIME)
    except DeviceError as error:
        found, _, advice = str(error).removeprefix("here: ").partition(": ")
        yield HostCheck("Haply's service", False, found, advice.partition("; `trocar")[0], needed=True)
        return
    yield HostCheck("Haply's service", True, f"answers at {host}:{port}", "")
    listed = ", ".join(f"{arm.device_id} ({key})" for key, arm in told.arms()) or "none"
    advice = "plug in and switch on the arm; name it as `settings: {id: ...}` if there are several"
    for arm in dict.fromkeys(arms):
        yield HostCheck(
            f"arm {arm or '(the only one)'}", _is_there(told, arm), f"listed: {listed}", advice, needed=True
        )
    for key, entry in told.arms():
        yield _state(key, entry.device_id, told)


def _is_there(told: Told, identity: str | None) -> bool:
    count = sum(1 for _ in told.arms())
    return count == 1 if identity is None else told.arm(identity) is not None


def _state(key: str, identity: str, told: Told) -> HostCheck:
    arm = told.arm(identity)
    status = None if arm is None else arm.status
    ok = status is not None and status.power_supply is not False and status.calibrated is not False
    found = (
        "no state" if status is None else f"power {_said(status.power_supply)}, calibrated {_said(status.calibrated)}"
    )
    return HostCheck(f"{key} {identity}", ok, found, "plug in its supply, and calibrate it as its maker says")


def _said(state: bool | None) -> str:
    return "not told" if state is None else "yes" if state else "no"
