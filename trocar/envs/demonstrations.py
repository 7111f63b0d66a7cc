"""Recordings as demonstrations: what was seen, felt and done at a steady rate, one for each attempt."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from trocar.envs.episode import FAST
from trocar.envs.hands import HandLimits
from trocar.envs.state import FIELDS, StateView
from trocar.protocol import Frame
from trocar.protocol.bodies import Attempt, GatewayState
from trocar.protocol.topics import TICK_S
from trocar.services.mechanics.arrays import Float32Array
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import read_arrays, read_frames
from trocar.services.training.site import read_site

Image = npt.NDArray[np.uint8]
_ATTEMPT = "training.attempt"
#: Share of the moments asked for that a recording has to have: a rig may lose some ticks.
_STEADY = 0.95
#: An attempt runs from its first motion on, which is seen when a hand has gone some way: it began to move by so long
#: before, or when the scene began.
_KEPT_S = 1
#: A moment that is due later than this is one of before the scene began anew.
_LONGEST_MS = 1000.0
_MOTIONS = ("x", "y", "z", "roll", "handle")
_FORCES = ("applied.x", "applied.y", "applied.z", "applied.torque")


class Camera(Protocol):
    """Draws the newest frames of a recording."""

    def image(self, frames: dict[str, Frame]) -> Image:
        """Return the picture (height, width, 3)."""


@dataclass
class Demonstration:
    """One attempt, or a whole recording that tells of none.

    Attributes:
        task: What was to be done, as the scenario calls it.
        outcome: success, failure or abandoned; empty where nobody judged it, or the recording ends before.
        states: (n, s) float32. `StateView`'s observation of each moment.
        forces: (n, 4 tools) float32. What each arm applied, N, and its handle's torque, N m.
        motions: (n, 5 tools). Where the hands were: J in m, roll and handle in rad.
        ticks: (n,). Times of the moments, ms.
        places: (n,). How many states of physics the recording holds before that of each moment.
    """

    task: str = ""
    outcome: str = ""
    states: list[Float32Array] = field(default_factory=list)
    forces: list[list[float]] = field(default_factory=list)
    motions: list[list[float]] = field(default_factory=list)
    ticks: list[int] = field(default_factory=list)
    places: list[int] = field(default_factory=list)

    def forget_moments(self, count: int) -> None:
        """Forget the oldest moments."""
        for kept in (self.states, self.forces, self.motions, self.ticks, self.places):
            del kept[:count]

    def actions(self) -> Float32Array:
        """Return the hands' velocities from each moment to the next (n - 1, 5 tools), as shares of the fastest.

        They are what an environment takes as actions; within its limits they lie between -1 and 1.
        """
        moved = np.diff(np.array(self.motions), axis=0) / (TICK_S * np.diff(self.ticks))[:, None]
        rates = np.broadcast_to(HandLimits().rates, (N_TOOLS, len(_MOTIONS))).reshape(-1)
        actions: Float32Array = (moved / rates).astype(np.float32)
        return actions


def state_names() -> list[str]:
    """Return a name for each number of a state."""
    return [".".join((each.name, *map(str, place))) for each in FIELDS for place in np.ndindex(each.shape)]


def force_names() -> list[str]:
    """Return a name for each number of the forces."""
    return [f"{tool}.{name}" for tool in range(N_TOOLS) for name in _FORCES]


def action_names() -> list[str]:
    """Return a name for each number of an action."""
    return [f"{tool}.{name}" for tool in range(N_TOOLS) for name in _MOTIONS]


def read_attempts(path: Path, fps: int) -> Iterator[Demonstration]:
    """Yield the attempts of a recording at a steady rate, each with the last second before its first motion.

    A recording without a word of attempts is one. Raises RecordingError if it is none, lacks its duct, or has fewer
    moments a second than asked for.
    """
    duct_file = read_arrays(path, "duct.npz")
    if duct_file is None:
        raise RecordingError(f"{path}: its duct is not in it")
    try:
        view = StateView(read_site(duct_file), duct_file)
    except (ValueError, KeyError) as error:
        raise RecordingError(f"{path}: its duct cannot be used: {error}") from None
    reader = _Reader(view, fps)
    for each in read_frames(path, (*FAST, _ATTEMPT)):
        reader.take_frame(each.frame)
        yield from reader.take_finished(path)
    reader.finish("")
    yield from reader.take_finished(path)


def draw_moments(path: Path, places: Iterable[int], camera: Camera) -> Iterator[Image]:
    """Yield the picture of each of some moments of a recording, drawn as it is asked for.

    Args:
        path: Path of the file.
        places: Rising, as in `Demonstration`.
        camera: What draws them.
    """
    wanted, newest, place = iter(places), dict[str, Frame](), -1
    due = next(wanted, None)
    for each in read_frames(path, (*FAST, _ATTEMPT)):
        if due is None:
            return
        newest[each.frame.topic] = each.frame
        place += each.frame.topic == FAST[-1]
        if place == due and each.frame.topic == FAST[-1]:
            yield camera.image(newest)
            due = next(wanted, None)


class _Reader:
    """Gathers moments; those of an attempt begin a little before its first motion is seen."""

    def __init__(self, view: StateView, fps: int) -> None:
        self._view, self._fps = view, fps
        self._newest: dict[str, Frame] = {}
        self._place = -1
        self._shown, self._finished = Demonstration(), list[Demonstration]()
        self._attempt_id, self._is_running, self._due_ms = "", True, -1.0

    def take_frame(self, frame: Frame) -> None:
        """Take what was sent."""
        self._newest[frame.topic] = frame
        self._place += frame.topic == FAST[-1]
        if frame.topic == _ATTEMPT:
            self._take_attempt(frame.body)
        elif frame.topic == FAST[-1] and self._newest.keys() >= set(FAST):
            self._take_moment(frame.body.tick)

    def take_finished(self, path: Path) -> Iterator[Demonstration]:
        """Yield what has ended since, but for what is shorter than two moments."""
        for shown in self._finished:
            if len(shown.ticks) > 1:
                rate_hz = (len(shown.ticks) - 1) / (TICK_S * (shown.ticks[-1] - shown.ticks[0]))
                if rate_hz < _STEADY * self._fps:
                    has = f"has {rate_hz:.0f} moments a second, fewer than the {self._fps} asked for"
                    raise RecordingError(f"{path}: {has}")
                yield shown
        self._finished = []

    def finish(self, outcome: str) -> None:
        """End what is gathered."""
        if self._is_running:
            self._shown.outcome = outcome
            self._finished.append(self._shown)
        self._shown, self._is_running = Demonstration(), False

    def _take_attempt(self, said: Attempt) -> None:
        if not self._attempt_id:
            self._is_running = False  # nobody has said before what was being done
        if self._is_running and (said.attempt_id != self._attempt_id or said.state != "running"):
            self.finish(said.outcome if said.attempt_id == self._attempt_id else "")
        if said.state == "running" and not self._is_running:
            self._is_running, shown = True, self._shown
            shown.task = said.title or said.scenario
            shown.forget_moments(int(np.searchsorted(shown.ticks, said.began_tick)))
        self._attempt_id = said.attempt_id or self._attempt_id

    def _take_moment(self, tick: int) -> None:
        if tick < self._due_ms <= tick + _LONGEST_MS:
            return
        is_steady = self._due_ms >= 0.0 and tick - self._due_ms < 1e3 / self._fps
        self._due_ms = (self._due_ms if is_steady else tick) + 1e3 / self._fps
        shown = self._shown
        if not self._is_running and len(shown.ticks) > _KEPT_S * self._fps:
            shown.forget_moments(1)
        shown.states.append(self._view.read(*(self._newest[topic].body for topic in FAST)))
        devices = self._newest[FAST[0]].body
        shown.forces.append(_padded(devices, _felt, len(_FORCES)))
        shown.motions.append(_padded(devices, _pose, len(_MOTIONS)))
        shown.ticks.append(tick)
        shown.places.append(self._place)


def _padded(devices: GatewayState, read: Any, size: int) -> list[float]:
    """Return what is read of each instrument, zeros for those that are not there."""
    found = [number for each in devices.instruments[:N_TOOLS] for number in read(each)]
    return found + [0.0] * (N_TOOLS * size - len(found))


def _felt(instrument: Any) -> tuple[float, ...]:
    return (*cast(tuple[float, float, float], instrument.applied_force_n), instrument.applied_grasp_torque_nm)


def _pose(instrument: Any) -> tuple[float, ...]:
    return (*cast(tuple[float, float, float], instrument.position_m), instrument.roll_rad, instrument.handle_angle_rad)
