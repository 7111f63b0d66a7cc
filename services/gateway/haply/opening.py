"""Opening an arm: find the service, choose the arm, set what the service does to forces, and see that it is set."""

from __future__ import annotations

import select
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException
from typing import Literal

import msgspec

from trocar.protocol.topics import TICK_S
from trocar.services.gateway.devices.asked_arm import OPEN_S
from trocar.services.gateway.devices.clock import Clock
from trocar.services.gateway.haply.arm_link import ArmLink
from trocar.services.gateway.haply.channel import Channel, open_channel
from trocar.services.gateway.haply.grip import Grip
from trocar.services.gateway.haply.messages import (
    FULL_STATE,
    ArmEntry,
    Basis,
    Config,
    GravitySetting,
    Told,
    settings_message,
    understand,
)
from trocar.services.runtime.config.rig import Vector3
from trocar.services.runtime.errors import DeviceError

DEFAULT_PORT = 10001  # by Haply's documentation of its Inverse service
#: A number that the service stores is the same to this, as it has 32 bits.
_SAME = 1e-5
_START = "start Haply Hub or the service `haply-inverse-service`; `trocar doctor` says more"

#: Arms of this process: host, port and identity.
_taken: set[tuple[str, int, str]] = set()


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which arm and grip of which service, and what the service adds to forces itself.

    Attributes:
        arm, grip: Identities; None: the only one.
        model: Of the device file, which has to be that of the arm.
        gravity: Share of the arm's weight that it bears itself.
        gate: Gain of the filter against oscillation.
    """

    host: str
    port: int
    arm: str | None
    grip: str | None
    roll_axis: Literal["x", "y", "z"]
    model: str
    centre_m: Vector3
    gravity: float
    damping_n_s_m: float
    gate: float


def open_arm(wanted: Wanted, where: str, shown: str, clock: Clock) -> ArmLink:
    """Return the session with an arm.

    Raises DeviceError: one sentence.
    """
    channel = open_service(wanted.host, wanted.port, where, clock)
    try:
        return _begin_session(channel, wanted, where, shown, clock)
    except DeviceError:
        channel.close()
        raise


def list_devices(host: str, port: int, clock: Clock) -> Told:
    """Return the inventory of a service.

    Raises DeviceError: one sentence.
    """
    channel = open_service(host, port, "here", clock)
    try:
        return _inventory(channel, "here", clock)
    finally:
        channel.close()


def open_service(host: str, port: int, where: str, clock: Clock) -> Channel:
    """Return a channel to the service at an address.

    Raises DeviceError: one sentence.
    """
    try:
        return open_channel(host, port, OPEN_S, clock)
    except OSError as error:
        why = error.strerror or str(error)
        raise DeviceError(f"{where}: no Haply service at {host}:{port} ({why}): {_START}") from None


def _begin_session(channel: Channel, wanted: Wanted, where: str, shown: str, clock: Clock) -> ArmLink:
    inventory = _inventory(channel, where, clock)
    key, arm = _choose_arm(inventory, wanted, where)
    grip = _choose_grip(inventory, wanted, where)
    _bear_weight(wanted, key, arm.device_id, where, clock)
    first = settings_message(key, arm.device_id, "trocar", wanted.damping_n_s_m, wanted.gate)
    _ask_service(channel, first, where, clock)
    full = _ask_service(channel, FULL_STATE, where, clock).arm(arm.device_id)
    if full is None or full.config is None:
        raise DeviceError(f"{where}: Haply's service does not tell how {shown} is set")
    if problem := _differs(full.config, wanted):
        raise DeviceError(f"{where}: {shown} {problem}")
    held = (grip, Grip(wanted.roll_axis)) if grip else None
    in_force = full.config.gravity_compensation, full.config.filters
    taken = (wanted.host, wanted.port, arm.device_id)
    if taken in _taken:
        raise DeviceError(
            f"{where}: another instrument has arm {arm.device_id}, and the service would add their forces"
        )
    _taken.add(taken)
    link = ArmLink(channel, key, arm.device_id, held, wanted.centre_m, shown, in_force)
    link.on_close = partial(_taken.discard, taken)
    return link


def _inventory(channel: Channel, where: str, clock: Clock) -> Told:
    told = _await_message(channel, where, clock)
    if told.session_id is None:
        raise DeviceError(f"{where}: Haply's service is older than 3.5, which is needed: update it with Haply Hub")
    return told


def _choose_arm(told: Told, wanted: Wanted, where: str) -> tuple[str, ArmEntry]:
    arms = list(told.arms())
    listed = ", ".join(arm.device_id for _, arm in arms) or "none"
    chosen = [(key, arm) for key, arm in arms if wanted.arm in (None, arm.device_id)]
    if not chosen:
        named = "arm" if wanted.arm is None else f"arm {wanted.arm!r}"
        raise DeviceError(f"{where}: Haply's service has no {named}; it lists: {listed}")
    if len(chosen) > 1:
        raise DeviceError(f"{where}: several arms are plugged in ({listed}): name one as `id` in the arm's settings")
    key, arm = chosen[0]
    said = (arm.config.type if arm.config is not None else "").lower() or key
    if ("minverse" in said) != ("minverse" in wanted.model.lower()):
        raise DeviceError(f"{where}: arm {arm.device_id} is a {said}, its device file is of {wanted.model}")
    return key, arm


def _choose_grip(told: Told, wanted: Wanted, where: str) -> str | None:
    grips = [grip.device_id for grip in told.grips()]
    if wanted.grip is not None or not grips:
        return wanted.grip
    if len(set(grips)) > 1:
        raise DeviceError(f"{where}: there are several grips ({', '.join(grips)}): name one as `grip` in the settings")
    return grips[0]


def _bear_weight(wanted: Wanted, key: str, identity: str, where: str, clock: Clock) -> None:
    """Set the compensation of the arm's weight, which only the service's HTTP does."""
    text = msgspec.json.encode({"enabled": wanted.gravity > 0.0, "scaling_factor": wanted.gravity})
    connection = HTTPConnection(wanted.host, wanted.port, timeout=OPEN_S)
    try:
        path = f"/{key}/{identity}/config/gravity_compensation"
        connection.request("POST", path, text, {"Content-Type": "application/json", "Connection": "close"})
        until_ns = clock.monotonic_ns() + round(1e9 * OPEN_S)
        while not select.select([connection.sock], [], [], 0.0)[0] and clock.monotonic_ns() < until_ns:
            clock.sleep(TICK_S)
        status = connection.getresponse().status
    except (OSError, HTTPException) as error:
        raise DeviceError(f"{where}: Haply's service does not set the compensation of weight: {error}") from None
    finally:
        connection.close()
    if status != HTTPStatus.OK:
        raise DeviceError(f"{where}: Haply's service refuses to set the compensation of weight: HTTP {status}")


def _ask_service(channel: Channel, message: bytes, where: str, clock: Clock) -> Told:
    channel.send(message)
    return _await_message(channel, where, clock)


def _await_message(channel: Channel, where: str, clock: Clock) -> Told:
    until_ns = clock.monotonic_ns() + round(1e9 * OPEN_S)
    while not (messages := channel.receive()):
        if channel.lost or clock.monotonic_ns() > until_ns:
            why = channel.lost or f"it says nothing for {OPEN_S:g} s"
            raise DeviceError(f"{where}: Haply's service does not answer ({why}): {_START}")
        clock.sleep(TICK_S)
    told = understand(messages[-1])
    if told is None:
        raise DeviceError(f"{where}: what answers for Haply's service speaks another format than 3.5")
    return told


def _differs(config: Config, wanted: Wanted) -> str:
    """Return in what an arm is set otherwise than it was told to be, or nothing."""
    gravity = GravitySetting(wanted.gravity > 0.0, wanted.gravity)
    told = config.gravity_compensation
    borne = told.scaling_factor if told.enabled else 0.0
    if config.basis.permutation != Basis().permutation:
        return f"has its axes as {config.basis.permutation}, not as XYZ"
    if not config.mount.is_identity():
        return "is mounted elsewhere for Haply's service: undo its mount in Haply Hub"
    if abs(borne - gravity.scaling_factor) > _SAME:
        return f"bears {borne:g} of its weight, not {wanted.gravity:g}"
    if abs(config.filters.damping.scalar - wanted.damping_n_s_m) > _SAME:
        return f"is damped with {config.filters.damping.scalar:g} N s/m, not {wanted.damping_n_s_m:g}"
    if abs(config.filters.force_gate.gain - wanted.gate) > _SAME:
        return f"has a force gate of {config.filters.force_gate.gain:g}, not {wanted.gate:g}"
    return ""
