"""Gamepads and SpaceMice by the Linux kernel's /dev/input/event*, read with the library evdev.

One file may serve several drivers of the process (two arms, two handles). They share one reader, which reads events at
most once a millisecond, never waits, and keeps the state of each axis and button (`input_axis`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

from evdev import InputDevice, ecodes, ff, list_devices

from trocar.protocol.topics import TICK_NS
from trocar.services.gateway.hands.input_axis import Axis, Button, RelativeAxis
from trocar.services.runtime.errors import DeviceError

#: Most events read in a tick; the rest is read in the next. A report of all axes of a device has at most ten.
_EVENTS_A_TICK = 32
#: Value of a fully pushed cap in a relative report, as of 3Dconnexion's devices.
_RELATIVE_FULL = 350.0
#: Interval of effects: each is written to the device, which takes some milliseconds by radio.
RUMBLE_EVERY_S = 0.1
#: Twice as long, so that an effect does not stop before the next.
_RUMBLE_MS = round(2e3 * RUMBLE_EVERY_S)


class EventSource(Protocol):
    """The used part of `evdev.InputDevice`."""

    path: str
    name: str

    def read_one(self) -> Any:
        """Return the next event, None without one."""
        ...

    def active_keys(self) -> list[int]:
        """Return the codes of the buttons that are pressed."""
        ...

    def capabilities(self, absinfo: bool = ...) -> dict[int, Any]:
        """Return codes by type, those of axes with their ranges."""
        ...

    def absinfo(self, axis_num: int) -> Any:
        """Ask the device for the range and the present value of an axis."""
        ...

    def upload_effect(self, effect: Any) -> int:
        """Upload an effect and return its number."""
        ...

    def write(self, etype: int, code: int, value: int) -> None:
        """Send an event, such as the start of an effect."""
        ...

    def close(self) -> None:
        """Close the device."""
        ...


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of input device, and how to recognise it.

    Attributes:
        name: Name in messages.
        is_one: Predicate of a device's capabilities, ``{type: [codes]}``.
        for_both: Whether one device has enough axes for both hands.
    """

    name: str
    is_one: Callable[[dict[int, list[int]]], bool]
    for_both: bool


GAMEPAD = Kind(
    "gamepad",
    lambda can: ecodes.BTN_SOUTH in can.get(ecodes.EV_KEY, ()) and ecodes.ABS_X in can.get(ecodes.EV_ABS, ()),
    for_both=True,
)
#: Six axes of translation and rotation, and no controls of a gamepad.
SPACEMOUSE = Kind(
    "SpaceMouse",
    lambda can: (
        {ecodes.REL_X, ecodes.REL_Z, ecodes.REL_RX, ecodes.REL_RZ} <= set(can.get(ecodes.EV_REL, ()))
        or (
            {ecodes.ABS_X, ecodes.ABS_Z, ecodes.ABS_RX, ecodes.ABS_RZ} <= set(can.get(ecodes.EV_ABS, ()))
            and ecodes.BTN_SOUTH not in can.get(ecodes.EV_KEY, ())
        )
    ),
    for_both=False,
)


@dataclass(slots=True)
class Inputs:
    """One device, with its axes and buttons.

    Attributes:
        fault: Empty, or one sentence on its loss.
    """

    source: EventSource
    fault: str = ""
    _axes: dict[int, Axis] = field(default_factory=dict)
    _relative: dict[int, RelativeAxis] = field(default_factory=dict)
    _buttons: dict[int, Button] = field(default_factory=dict)
    _read_ns: int = -1
    _rumbles: bool = False
    _effect: int = -1
    _dropped: bool = False
    users: int = 0

    def __post_init__(self) -> None:
        can = self.source.capabilities(absinfo=True)
        self._rumbles = ecodes.FF_RUMBLE in can.get(ecodes.EV_FF, ())
        pressed = set(self.source.active_keys())
        self._buttons = {code: Button(code in pressed) for code in can.get(ecodes.EV_KEY, ())}
        self._relative = {code: RelativeAxis(_RELATIVE_FULL) for code in can.get(ecodes.EV_REL, ())}
        for code, _ in can.get(ecodes.EV_ABS, ()):
            info = self.source.absinfo(code)  # those of the capabilities are from when it was opened
            self._axes[code] = Axis(float(info.min), float(info.max), float(info.value))

    def _synchronise(self, time_ns: int) -> None:
        """Report the present values of all axes and buttons, as events have been lost."""
        pressed = set(self.source.active_keys())
        for code, button in self._buttons.items():
            if button.is_pressed != (code in pressed):
                button.report(code in pressed, time_ns)
        for code, axis in self._axes.items():
            value = float(self.source.absinfo(code).value)
            if value != axis.raw:
                axis.report(value, time_ns)

    def _control(self, name: str) -> Axis | RelativeAxis | Button | None:
        kind, code = code_of(name)
        if self.fault:
            return None
        if kind == ecodes.EV_ABS:
            return self._axes.get(code)
        return self._relative.get(code) if kind == ecodes.EV_REL else self._buttons.get(code)

    def has(self, name: str) -> bool:
        """Return whether the device is there and has this axis or button."""
        return self._control(name) is not None

    def value(self, name: str) -> float:
        """Return how far an axis or button is pushed from its rest, by its kernel name (`code_of`), -1 to 1.

        It is 0 if the device lacks it, is lost, or has not shown yet where it rests.
        """
        return self.trigger(name) if self.rests_at_end(name) else self.stick(name)

    def stick(self, name: str) -> float:
        """Return `value`, but 0 for an axis that rests at an end."""
        control = self._control(name)
        return control.stick() if isinstance(control, Axis) else self._pushed(control)

    def trigger(self, name: str) -> float:
        """Return `value`, but 0 for an axis that rests in its middle."""
        control = self._control(name)
        return control.trigger() if isinstance(control, Axis) else self._pushed(control)

    def _pushed(self, control: RelativeAxis | Button | None) -> float:
        if isinstance(control, RelativeAxis):
            return control.value(self._read_ns)
        return 0.0 if control is None else control.value()

    def rests_in_middle(self, name: str) -> bool:
        """Return whether this is an absolute axis that rests in its middle."""
        control = self._control(name)
        return isinstance(control, Axis) and control.middle is not None

    def rests_at_end(self, name: str) -> bool:
        """Return whether this is an absolute axis that rests at an end, and has not been seen to be a stick."""
        control = self._control(name)
        return isinstance(control, Axis) and control.end is not None and control.middle is None

    def problem(self, name: str) -> str:
        """Return what keeps an axis or button of the device from being used, as "ABS_Z never rests", or empty."""
        control = self._control(name)
        found = "" if control is None else control.problem(self._read_ns)
        return f"{name} {found}" if found else ""

    def learn_anew(self) -> None:
        """Forget where axes rest, as a person has armed the rig with the device at rest."""
        for axis in self._axes.values():
            axis.learn_anew(self._read_ns)

    def poll(self, time_ns: int) -> None:
        """Read events up to `time_ns`, once in a tick. All values of a lost device are 0."""
        if self.fault or time_ns - self._read_ns < TICK_NS:
            return
        self._read_ns = time_ns
        try:
            is_all = self._read(time_ns)
        except OSError:
            self.fault = f"{self.source.name} ({self.source.path}) went away"
            return
        came = [axis for axis in self._axes.values() if axis.reported_ns == time_ns and axis.came_to_middle]
        if len(came) > 1:  # a finger moves one half the way at once, but not two
            for axis in came:
                axis.learn_anew(time_ns)
        if is_all:
            for controls in (self._axes, self._relative, self._buttons):
                for control in controls.values():
                    control.advance(time_ns)

    def _read(self, time_ns: int) -> bool:
        """Read some events; return whether these were all."""
        for _ in range(_EVENTS_A_TICK):
            event = self.source.read_one()
            if event is None:
                return True
            self._take_event(event, time_ns)
        return False

    def _take_event(self, event: Any, time_ns: int) -> None:
        if event.type == ecodes.EV_SYN and event.code == ecodes.SYN_DROPPED:
            self._dropped = True  # the kernel's queue overflowed; events up to the next report are incomplete
        elif self._dropped:
            if event.type == ecodes.EV_SYN and event.code == ecodes.SYN_REPORT:
                self._dropped = False
                self._synchronise(time_ns)
        elif event.type == ecodes.EV_KEY and event.code in self._buttons:
            self._buttons[event.code].report(bool(event.value), time_ns)
        elif event.type == ecodes.EV_ABS and event.code in self._axes:
            self._axes[event.code].report(float(event.value), time_ns)
        elif event.type == ecodes.EV_REL and event.code in self._relative:
            self._relative[event.code].report(float(event.value), time_ns)

    def rumble(self, strength: float) -> None:
        """Rumble for a fifth of a second with `strength` 0 to 1, if the device can."""
        if not self._rumbles or self.fault:
            return
        level = int(0xFFFF * min(max(strength, 0.0), 1.0))
        motors = ff.EffectType(ff_rumble_effect=ff.Rumble(strong_magnitude=level, weak_magnitude=level // 2))
        shake = ff.Effect(ecodes.FF_RUMBLE, self._effect, 0, ff.Trigger(0, 0), ff.Replay(_RUMBLE_MS, 0), motors)
        try:
            self._effect = self.source.upload_effect(shake)
            self.source.write(ecodes.EV_FF, self._effect, 1)
        except OSError:
            self._rumbles = False  # no permission to write


def code_of(name: str) -> tuple[int, int]:
    """Return type and code of an axis or button, such as ``ABS_X``, ``REL_RZ`` or ``BTN_SOUTH``.

    Raises ValueError if the kernel knows no such name.
    """
    code = ecodes.ecodes.get(name)
    kinds = {"ABS": ecodes.EV_ABS, "REL": ecodes.EV_REL, "BTN": ecodes.EV_KEY, "KEY": ecodes.EV_KEY}
    kind = kinds.get(name.partition("_")[0])
    if kind is None or not isinstance(code, int):
        raise ValueError(f"{name!r} is no axis or button: names are those of the kernel, as ABS_X, REL_RZ, BTN_SOUTH")
    return kind, code


_open: dict[str, Inputs] = {}


def open_inputs(kind: Kind, path: str | None, index: int, where: str) -> Inputs:
    """Return the device at `path`, or the one of `kind` for the instrument `index`.

    Raises DeviceError: one sentence, if there is none or it cannot be opened.
    """
    path = path or _choose(kind, index, where)
    if path not in _open or _open[path].fault:
        try:
            _open[path] = Inputs(open_source(path))
        except OSError as error:
            raise DeviceError(f"{where}: {path}: {error.strerror or error}") from None
    _open[path].users += 1
    return _open[path]


def _choose(kind: Kind, index: int, where: str) -> str:
    found = find_devices(kind)
    advice = "plug one in, name its file as `device`, or see `trocar doctor`"
    if not found:
        raise DeviceError(f"{where}: there is no {kind.name} in /dev/input that this user may read: {advice}")
    if index < len(found):
        return found[index]
    if not kind.for_both:
        raise DeviceError(f"{where}: there are {len(found)} of {kind.name} and this is hand {index + 1}: {advice}")
    return found[-1]


def close_inputs(inputs: Inputs) -> None:
    """Release a device; the last user closes it."""
    inputs.users -= 1
    if inputs.users <= 0:
        if _open.get(inputs.source.path) is inputs:
            del _open[inputs.source.path]
        inputs.source.close()


def find_devices(kind: Kind) -> list[str]:
    """Return the files of all devices of a kind that this user may read."""
    return [path for path in sorted(list_paths()) if _is_one(kind, path)]


def _is_one(kind: Kind, path: str) -> bool:
    try:
        source = open_source(path)
    except OSError:
        return False
    try:
        return kind.is_one(source.capabilities(absinfo=False))
    finally:
        source.close()


def _open_device(path: str) -> EventSource:
    return cast(EventSource, InputDevice(path))


#: Functions that list and open devices, which test benches replace.
list_paths: Callable[[], list[str]] = list_devices
open_source: Callable[[str], EventSource] = _open_device
