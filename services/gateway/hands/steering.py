"""Rate control of instruments: the deflection of an axis sets the tool's velocity, for gamepad and SpaceMouse."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.hands import input_events
from trocar.services.gateway.hands.hand_arm import HandArm, HandSettings
from trocar.services.gateway.hands.hand_grasp import HandGrasp, HandGraspSettings
from trocar.services.gateway.hands.input_axis import DEAD
from trocar.services.gateway.hands.input_events import RUMBLE_EVERY_S, Inputs, Kind
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.config.bounds import between
from trocar.services.runtime.config.rig import Settings
from trocar.services.runtime.errors import DeviceError

#: Motions of the tool by axes: sideways and up as seen along the shaft, along the shaft, about it.
MOTIONS = ("right", "up", "inward", "roll")
Axes = dict[str, Annotated[float, between(-10.0, 10.0, "", "an axis goes from -1 to 1, and its sign is 1 or -1")]]
#: A tool goes no further after the process stood still, as a person could not let go meanwhile: about a picture at 20
#: Hz.
_LONGEST_STEP_S = 0.05
#: Force at which a gamepad rumbles with full strength: a little below the 2.6 N that count as an error (`scenario`).
_RUMBLE_FULL_N = 2.0


class DeviceSettings(Settings):
    """Choice of the input device."""

    device: Path | None = Field(None, description="file such as /dev/input/event7; none: found by its axes")


def _check_axes(axes: Axes) -> Axes:
    for name in axes:
        input_events.code_of(name)
    return axes


class SteeringSettings(HandSettings, DeviceSettings):
    """Axes and speeds of the tool."""

    speed_m_s: Annotated[float, between(1e-4, 0.5, "m/s", "no hand steers a tool faster, and it has to move")] = Field(
        0.05, description="speed while an axis is at its end"
    )
    roll_rad_s: Annotated[float, between(1e-3, 10.0, "rad/s", "no hand turns a tool faster, and it has to turn")] = 1.5
    axes: dict[str, Axes] = Field({}, description="by motion: kernel names of axes and buttons, and their signs")

    @field_validator("axes")
    @classmethod
    def _are_known(cls, axes: dict[str, Axes]) -> dict[str, Axes]:
        for motion, names in axes.items():
            if motion not in MOTIONS:
                near = did_you_mean(motion, MOTIONS)
                raise ValueError(f"there is no motion {motion!r}; known: {', '.join(MOTIONS)}{near}")
            _check_axes(names)
        return axes


class JawSettings(HandGraspSettings, DeviceSettings):
    """Controls that close the jaws."""

    close: Axes = Field({}, description="kernel names of axes and buttons, and their signs")

    @field_validator("close")
    @classmethod
    def _are_known(cls, close: Axes) -> Axes:
        return _check_axes(close)


@dataclass(frozen=True, slots=True)
class Control:
    """The axes and buttons of one motion, or of the jaws, and their signs.

    Those of a layout are alternatives, of which a device uses the ones that rest where this control needs them: sticks
    in their middle, triggers at an end. Those that a rig file names are used however they rest.
    """

    axes: Axes
    is_named: bool
    is_trigger: bool = False

    def pushed(self, inputs: Inputs) -> float:
        """Return the sum of the deflections, -1 to 1, before the dead zone."""
        return min(max(sum(sign * self._value(inputs, name) for name, sign in self.axes.items()), -1.0), 1.0)

    def _value(self, inputs: Inputs, name: str) -> float:
        if self.is_named:
            return inputs.value(name)
        if not self.is_trigger:
            return inputs.stick(name)
        is_replaced = name.startswith("BTN_") and any(map(inputs.rests_at_end, self.axes))
        return 0.0 if is_replaced else inputs.trigger(name)  # a trigger's own button is pressed long before its end

    def problem(self, inputs: Inputs) -> str:
        """Return what keeps it from being used, or empty; of alternatives one is enough."""
        own = [found for found in map(inputs.problem, self.axes) if found]
        if self.is_named:
            return ", ".join(own)
        fits, misfits = inputs.rests_in_middle, inputs.rests_at_end
        if self.is_trigger:
            fits, misfits = misfits, fits
        if any(map(fits, self.axes)):
            return ""
        if not any(inputs.has(name) and not name.startswith("ABS_") for name in self.axes):
            where = "in its middle" if self.is_trigger else "at an end"
            own += [f"{name} rests {where}" for name in self.axes if misfits(name)]
        return ", ".join(own)


def problems(inputs: Inputs, controls: Iterable[Control]) -> str:
    """Return one sentence that names what of a device is not used, or empty."""
    found = ", ".join(dict.fromkeys(filter(None, (control.problem(inputs) for control in controls))))
    return f"{inputs.source.name} ({inputs.source.path}) is not used in part: {found}: let go of it" if found else ""


def shaped(push: float) -> float:
    """Return the fraction of full speed: 0 in the dead zone, fine control beyond it, 1 at the end."""
    beyond = max(abs(push) - DEAD, 0.0) / (1.0 - DEAD)
    return (0.3 * beyond + 0.7 * beyond**3) * (1.0 if push > 0.0 else -1.0)


def shaft_axes(hip: FloatArray, port: FloatArray) -> FloatArray:
    """Return right, up and inward (rows, (3, 3)) as seen from the port along the shaft; z is up in the world."""
    inward = hip - port
    inward = inward / max(float(np.linalg.norm(inward)), 1e-9)
    right = np.cross(inward, (0.0, 0.0, 1.0))
    length = float(np.linalg.norm(right))
    right = right / length if length > 1e-6 else np.array((1.0, 0.0, 0.0))
    return np.array((right, np.cross(right, inward), inward))


class Source:
    """The input device of one driver, searched for when it opens and again when a person arms the rig.

    Attributes:
        inputs: Inputs or None. None without a device.
    """

    def __init__(self, kind: Kind, settings: DeviceSettings, place: Place) -> None:
        self.inputs: Inputs | None = None
        self._kind, self._place = kind, place
        self._path = str(settings.device) if settings.device is not None else None

    def open(self) -> None:
        """Open the device; raises `DeviceError` if it is missing."""
        where = f"instrument {self._place.instrument!r}"
        self.inputs = input_events.open_inputs(self._kind, self._path, self._place.index, where)

    def reopen(self) -> str:
        """Reopen the device without raising, and learn its places of rest; return the reason of a failure, or empty."""
        self.close()
        try:
            self.open()
        except DeviceError as error:
            return str(error)
        if self.inputs is not None:
            self.inputs.learn_anew()
        return ""

    def close(self) -> None:
        """Release the device."""
        if self.inputs is not None:
            input_events.close_inputs(self.inputs)
            self.inputs = None


class SteeredArm(HandArm):
    """Moves while an axis is deflected. The loss of the input is a fault, and the tool then holds still."""

    def __init__(
        self, name: str, kind: Kind, axes: Mapping[str, Axes], settings: SteeringSettings, place: Place
    ) -> None:
        super().__init__(name, settings, place)
        self._source = Source(kind, settings, place)
        layout = {motion: Control(names, is_named=False) for motion, names in axes.items()}
        self._controls = layout | {motion: Control(names, is_named=True) for motion, names in settings.axes.items()}
        self._steering = settings
        self._port = np.array(place.port_m)
        self._rumbled_s = 0.0

    def open(self) -> None:
        """Open the device and put the tool at its start."""
        super().open()
        self._source.open()

    def move_target(self, time_ns: int, passed_s: float) -> None:
        """Move the target by the axes' deflections."""
        inputs = self._source.inputs
        if inputs is None:
            return
        inputs.poll(time_ns)
        self.fault = inputs.fault
        self.prompt = problems(inputs, self._controls.values())
        step_s = min(passed_s, _LONGEST_STEP_S)
        right, up, inward, roll = (shaped(self._pushed(inputs, motion)) for motion in MOTIONS)
        way = np.array((right, up, inward)) @ shaft_axes(self.target, self._port)
        self.target = self.target + step_s * self._steering.speed_m_s * way
        self.target_roll += step_s * self._steering.roll_rad_s * roll
        self._rumble(inputs, step_s)

    def _pushed(self, inputs: Inputs, motion: str) -> float:
        control = self._controls.get(motion)
        return 0.0 if control is None else control.pushed(inputs)

    def _rumble(self, inputs: Inputs, passed_s: float) -> None:
        self._rumbled_s += passed_s
        force_n = float(np.linalg.norm(self.felt_n))
        if force_n > 0.05 and self._rumbled_s >= RUMBLE_EVERY_S:
            self._rumbled_s = 0.0
            inputs.rumble(force_n / _RUMBLE_FULL_N)

    def clear_fault(self) -> None:
        """Search for the device again."""
        super().close()
        self.fault = self._source.reopen()

    def close(self) -> None:
        """Give the device up."""
        super().close()
        self._source.close()


class SteeredGrasp(HandGrasp):
    """Closes the jaws as far as a trigger is pressed, or while a button is."""

    def __init__(self, kind: Kind, close: Axes, settings: JawSettings, place: Place) -> None:
        super().__init__(settings, place)
        self._source = Source(kind, settings, place)
        self._control = Control(settings.close or close, is_named=bool(settings.close), is_trigger=True)
        self._touched = False

    def open(self) -> None:
        """Open the device."""
        self._source.open()

    def opening(self, time_ns: int) -> float | None:
        """Return the opening by the trigger; None until it is first touched."""
        inputs = self._source.inputs
        if inputs is None:
            return None
        inputs.poll(time_ns)
        self.fault = inputs.fault
        self.prompt = problems(inputs, (self._control,))
        closed = self._control.pushed(inputs)
        self._touched |= closed > DEAD
        return 1.0 - max(closed, 0.0) if self._touched and not self.fault else None

    def clear_fault(self) -> None:
        """Search for the device again; after a loss the grip is kept until the trigger is pressed."""
        self._touched &= not self.fault
        self.fault = self._source.reopen()

    def close(self) -> None:
        """Give the device up."""
        self._source.close()


def check_inputs(kind: Kind) -> HostCheck:
    """Check that a device of this kind exists and is readable, for `trocar doctor`."""
    found = input_events.find_devices(kind)
    advice = (
        f"plug a {kind.name} in; if it is, let this user read /dev/input: `sudo usermod -aG input $USER`, then log in "
        "anew; another driver that holds it (spacenavd) must be stopped"
    )
    return HostCheck(f"{kind.name}", bool(found), ", ".join(found) or "none in /dev/input", advice, needed=True)
