"""Input devices that are not there: what benches and tests hold in their hands."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from evdev import AbsInfo, InputEvent, ecodes

from trocar.services.gateway.hands import input_events


class InputStandIn:
    """An input device as `input_events.EventSource` wants it; `say` is a hand on it.

    Attributes
    ----------
    shaken : list of int
        The strong motor's magnitude of each rumble so far.
    """

    def __init__(self, path: str, name: str, capabilities: dict[int, Any]) -> None:
        self.path, self.name = path, name
        self._capabilities = capabilities
        self._axes = dict(capabilities.get(ecodes.EV_ABS, ()))
        self._events: deque[InputEvent] = deque()
        self._unplugged = False
        self._last_effect = 0
        self.shaken: list[int] = []
        self.closed = 0
        self.pressed: list[int] = []

    def active_keys(self) -> list[int]:
        """Return what is pressed now, whether or not an event said so."""
        return self.pressed

    def run_over(self, axis: str, value: int, pressed: list[str]) -> None:
        """Lose events as the kernel does where nobody reads: the axis and buttons stand so when it tells of that."""
        code = ecodes.ecodes[axis]
        self._axes[code] = self._axes[code]._replace(value=value)
        self.pressed = [ecodes.ecodes[name] for name in pressed]
        self._events.append(InputEvent(0, 0, ecodes.EV_SYN, ecodes.SYN_DROPPED, 0))
        self._events.append(InputEvent(0, 0, ecodes.EV_ABS, code, -value))  # half of a report
        self._events.append(InputEvent(0, 0, ecodes.EV_SYN, ecodes.SYN_REPORT, 0))

    def say(self, code_name: str, value: int) -> None:
        """Let an axis or a button say `value`, in the device's own numbers."""
        kind = {"ABS": ecodes.EV_ABS, "REL": ecodes.EV_REL, "BTN": ecodes.EV_KEY}[code_name[:3]]
        code = ecodes.ecodes[code_name]
        if kind == ecodes.EV_ABS:
            self._axes[code] = self._axes[code]._replace(value=value)
        self._events.append(InputEvent(0, 0, kind, code, value))

    def unplug(self) -> None:
        """Answer from now on as the kernel does for what is gone."""
        self._unplugged = True

    def read_one(self) -> InputEvent | None:
        """Return the next event, None when there is none."""
        if self._unplugged:
            raise OSError(19, "No such device")
        return self._events.popleft() if self._events else None

    def capabilities(self, absinfo: bool = True) -> dict[int, Any]:
        """Return what it can do, in the shape of `evdev.InputDevice.capabilities`: values are those of the opening."""
        if absinfo:
            return self._capabilities
        return {
            kind: [c[0] if isinstance(c, tuple) else c for c in codes] for kind, codes in self._capabilities.items()
        }

    def absinfo(self, axis_num: int) -> AbsInfo:
        """Return an axis as it stands now."""
        return self._axes[axis_num]

    def upload_effect(self, effect: Any) -> int:
        """Remember a rumble."""
        self._last_effect = effect.u.ff_rumble_effect.strong_magnitude
        return 0

    def write(self, etype: int, code: int, value: int) -> None:
        """Play what was uploaded."""
        if etype == ecodes.EV_FF and value:
            self.shaken.append(self._last_effect)

    def close(self) -> None:
        """Count how often it was closed."""
        self.closed += 1


def _axis(low: int, high: int, value: int = 0) -> AbsInfo:
    return AbsInfo(value, low, high, 0, 0, 0)


def gamepad(path: str = "/dev/input/event5") -> InputStandIn:
    """Return a gamepad in the ranges of the common ones: sticks of 16 bits, triggers of 8."""
    sticks = [(code, _axis(-32768, 32767)) for code in (ecodes.ABS_X, ecodes.ABS_Y, ecodes.ABS_RX, ecodes.ABS_RY)]
    triggers = [(code, _axis(0, 255)) for code in (ecodes.ABS_Z, ecodes.ABS_RZ)]
    hat = [(code, _axis(-1, 1)) for code in (ecodes.ABS_HAT0X, ecodes.ABS_HAT0Y)]
    buttons = [ecodes.BTN_SOUTH, ecodes.BTN_EAST, ecodes.BTN_TL, ecodes.BTN_TR]
    can = {ecodes.EV_KEY: buttons, ecodes.EV_ABS: sticks + triggers + hat, ecodes.EV_FF: [ecodes.FF_RUMBLE]}
    return InputStandIn(path, "Stand-in gamepad", can)


def spacemouse(path: str = "/dev/input/event6", absolute: bool = False) -> InputStandIn:
    """Return a SpaceMouse as most kernels show it, with relative axes, or as some do, with absolute ones."""
    names = ("X", "Y", "Z", "RX", "RY", "RZ")
    buttons = {ecodes.EV_KEY: [ecodes.BTN_0, ecodes.BTN_1]}
    if absolute:
        axes = [(ecodes.ecodes[f"ABS_{name}"], _axis(-350, 350)) for name in names]
        return InputStandIn(path, "Stand-in SpaceMouse", {**buttons, ecodes.EV_ABS: axes})
    return InputStandIn(
        path, "Stand-in SpaceMouse", {**buttons, ecodes.EV_REL: [ecodes.ecodes[f"REL_{n}"] for n in names]}
    )


@contextmanager
def only(source: input_events.EventSource) -> Iterator[None]:
    """Let `source` be the only input device of this host."""
    before = input_events.list_paths, input_events.open_source
    input_events.list_paths, input_events.open_source = (lambda: [source.path]), (lambda _path: source)
    try:
        yield
    finally:
        input_events.list_paths, input_events.open_source = before
