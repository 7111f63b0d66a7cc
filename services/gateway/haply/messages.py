"""Messages of the service: what is sent, and what is taken of an answer.

Of an answer only what is named here is read; the rest may be anything. A field of another type than here makes an
answer one that is not understood, as no part of it is believed then.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec

from trocar.services.runtime.config.rig import Vector3

#: Under which keys the service lists arms, and grips.
ARMS, GRIPS = ("inverse3", "inverse3x", "minverse"), ("wireless_verse_grip", "verse_grip", "custom_verse_grip")


class Xyz(msgspec.Struct, frozen=True):
    """A vector; a number that was left out is None."""

    x: float | None = None
    y: float | None = None
    z: float | None = None

    def complete(self) -> Vector3 | None:
        """Return it, or None if a number is missing: left out may mean zero or unchanged, and only one is right."""
        return None if self.x is None or self.y is None or self.z is None else (self.x, self.y, self.z)


class Wxyz(msgspec.Struct, frozen=True):
    """A quaternion."""

    w: float | None = None
    x: float | None = None
    y: float | None = None
    z: float | None = None


class Buttons(msgspec.Struct, frozen=True):
    """Buttons of a grip."""

    a: bool = False
    b: bool = False
    c: bool = False


class ArmState(msgspec.Struct, frozen=True):
    """Where an arm is."""

    cursor_position: Xyz | None = None


class ArmStatus(msgspec.Struct, frozen=True):
    """What an arm can do; None: not told."""

    calibrated: bool | None = None
    power_supply: bool | None = None
    ready: bool | None = None


class Transform(msgspec.Struct, frozen=True):
    """A placement in space, told as far as it differs from none."""

    position: Xyz = Xyz()
    rotation: Wxyz = Wxyz()
    scale: Xyz = Xyz()

    def is_identity(self) -> bool:
        """Return whether it changes nothing."""
        turned = (self.rotation.x, self.rotation.y, self.rotation.z)
        moved = (self.position.x, self.position.y, self.position.z)
        sized = (self.scale.x, self.scale.y, self.scale.z)
        return not any(map(bool, (*turned, *moved))) and all(size is None or size == 1.0 for size in sized)


class Basis(msgspec.Struct, frozen=True):
    """Which axes are meant by x, y and z."""

    permutation: str = "XYZ"


class Gravity(msgspec.Struct, frozen=True):
    """Compensation of the arm's own weight."""

    enabled: bool = False
    scaling_factor: float = 1.0


class Gate(msgspec.Struct, frozen=True):
    """Filter against oscillation."""

    gain: float = 0.0


class Damping(msgspec.Struct, frozen=True):
    """Filter that brakes."""

    scalar: float = 0.0


class Filters(msgspec.Struct, frozen=True):
    """Filters of the service, which change what is felt."""

    force_gate: Gate = Gate()
    damping: Damping = Damping()


class Config(msgspec.Struct, frozen=True):
    """How an arm is set."""

    type: str = ""
    basis: Basis = Basis()
    mount: Transform = Transform()
    gravity_compensation: Gravity = Gravity()
    filters: Filters = Filters()


class ArmEntry(msgspec.Struct, frozen=True):
    """What is told of one arm."""

    device_id: str = ""
    config: Config | None = None
    state: ArmState = ArmState()
    status: ArmStatus = ArmStatus()


class GripState(msgspec.Struct, frozen=True):
    """How a grip is held."""

    orientation: Wxyz | None = None
    buttons: Buttons = Buttons()
    button: bool = False


class GripStatus(msgspec.Struct, frozen=True):
    """Whether a grip answers; None: not told."""

    awake: bool | None = None
    connected: bool | None = None


class GripEntry(msgspec.Struct, frozen=True):
    """What is told of one grip."""

    device_id: str = ""
    state: GripState = GripState()
    status: GripStatus = GripStatus()


class Told(msgspec.Struct, frozen=True):
    """An answer, or the inventory at the begin, which alone has a session of the format 3.5."""

    session_id: int | None = None
    inverse3: tuple[ArmEntry, ...] = ()
    inverse3x: tuple[ArmEntry, ...] = ()
    minverse: tuple[ArmEntry, ...] = ()
    wireless_verse_grip: tuple[GripEntry, ...] = ()
    verse_grip: tuple[GripEntry, ...] = ()
    custom_verse_grip: tuple[GripEntry, ...] = ()

    def arms(self) -> Iterator[tuple[str, ArmEntry]]:
        """Yield every arm with the key that it is under."""
        for key in ARMS:
            for arm in getattr(self, key):
                yield key, arm

    def grips(self) -> Iterator[GripEntry]:
        """Yield every grip."""
        for key in GRIPS:
            yield from getattr(self, key)

    def arm(self, identity: str) -> ArmEntry | None:
        """Return the arm of this identity."""
        return next((arm for _, arm in self.arms() if arm.device_id == identity), None)

    def grip(self, identity: str) -> GripEntry | None:
        """Return the grip of this identity."""
        return next((grip for grip in self.grips() if grip.device_id == identity), None)


_DECODER = msgspec.json.Decoder(Told)


def understand(text: bytes | bytearray) -> Told | None:
    """Return an answer, or None if it is none of this format."""
    try:
        return _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


def force_message(key: str, identity: str, force_n: Vector3) -> bytes:
    """Return the message that gives an arm a force in the service's axes, once."""
    x, y, z = (part if math.isfinite(part) else 0.0 for part in force_n)
    vector = {"x": x, "y": y, "z": z}
    return msgspec.json.encode({key: [{"device_id": identity, "commands": {"set_cursor_force": {"vector": vector}}}]})


def settings_message(key: str, identity: str, name: str, damping: float, gate: float) -> bytes:
    """Return the first message of a session: who is here, and which axes and filters the arm has for it."""
    configure = {
        "preset": {"preset": "defaults"},
        "basis": {"permutation": Basis().permutation},
        "damping": {"scalar": damping},
        "force_gate": {"gain": gate},
    }
    return msgspec.json.encode(
        {
            "session": {"configure": {"profile": {"name": name}}},
            key: [{"device_id": identity, "configure": configure}],
        }
    )


#: Asks for an answer with the configuration of all devices.
FULL_STATE = msgspec.json.encode({"session": {"force_render_full_state": {}}})
