"""Inputs of a recorded simulation, tick by tick, with which it can be repeated to the bit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

import msgspec

from trocar.protocol import Frame
from trocar.protocol.bodies import Journal, PhysicsState, ToolContacts
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.provenance import machine, mechanics_digest
from trocar.services.recordings.reader import RecordedFrame, read_extras, read_frames

_DEVICES = "gateway.state"
_JOURNALS = ("haptics.journal", "physics.journal")
#: A journal is sent every 128 ticks, so that a run of thirty times as many is none.
_LONGEST_RUN = 1 << 12
#: Of a short recording whose first device frames are missing: a hundred seconds, longer than any start.
_TICKS_AT_LEAST = 100_000
#: Fields of an instrument that physics receives.
_TOLD = ("position_m", "orientation_wxyz", "roll_rad", "handle_angle_rad")
_SOLVED = ("physics.state", "haptics.contacts")


@dataclass(frozen=True, slots=True)
class Intake:
    """Inputs of haptics and physics at one tick of the rig's clock.

    Attributes:
        devices: The device frame.
        seen_tick: Tick of the newest state known to haptics, -1 for none; `is_fresh`: whether it was fresh.
        ticks: Number of ticks that physics advanced with the answer of haptics, 0 if it missed that.
        level: Quality level.
    """

    tick: int
    devices: Frame
    seen_tick: int = -1
    is_fresh: bool = False
    ticks: int = 0
    level: int = 0


@dataclass(slots=True)
class RecordedInputs:
    """Inputs and, if recorded, results of a simulation.

    Attributes:
        intakes: Inputs in the order of ticks, from the start of the simulation.
        states, contacts: Recorded messages of physics and haptics, by tick.
        ended: Why the inputs end before the file does, empty otherwise.
        guessed: Number of ticks at the start without device frames, for which moving hands are assumed at their first
            recorded position.
    """

    path: Path
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    intakes: list[Intake] = field(default_factory=list)
    states: dict[int, PhysicsState] = field(default_factory=dict)
    contacts: dict[int, ToolContacts] = field(default_factory=dict)
    ended: str = ""
    guessed: int = 0

    @property
    def machine_differs(self) -> bool:
        """Whether it was recorded on another kind of machine, so that the last bits may differ."""
        return self.metadata.get("machine") != machine()

    @property
    def other_mechanics(self) -> str:
        """One sentence if it was made by another version of the mechanics, else empty."""
        theirs = self.metadata.get("mechanics", "")
        if theirs == mechanics_digest():
            return ""
        return (
            f"{self.path}: was made by another version of the mechanics ({theirs[:12] or 'not named'}, these are "
            f"{mechanics_digest()[:12]}): the same hands may lead elsewhere; --pictures shows what was recorded"
        )

    def check_scene(self) -> None:
        """Raise RecordingError if its scene is not in it."""
        if "scene.yaml" not in self.attachments:
            raise RecordingError(f"{self.path}: its scene is not in it")


def read_inputs(path: Path) -> RecordedInputs:
    """Return the inputs in a recording, up to the restart of a process.

    Raises RecordingError if it is no recording, or lacks the inputs from the simulation's start.
    """
    metadata, attachments = read_extras(path)
    inputs = RecordedInputs(path, metadata.get("trocar", {}), attachments)
    devices: dict[int, Frame] = {}
    journals: dict[str, list[Journal]] = {name: [] for name in _JOURNALS}
    for recorded in takewhile(_FirstIncarnation(inputs), read_frames(path, (_DEVICES, *_JOURNALS, *_SOLVED))):
        frame = recorded.frame
        if frame.topic == _DEVICES:
            devices[frame.sequence] = frame
        elif frame.topic == "physics.state":
            inputs.states[frame.body.tick] = frame.body
        elif frame.topic == "haptics.contacts":
            inputs.contacts[frame.body.tick] = frame.body
        else:
            journals[frame.topic].append(frame.body)
    _judge_counts(inputs, journals, len(devices))
    inputs.intakes += _intakes(inputs, devices, *(_ticks(inputs, name, journals[name]) for name in _JOURNALS))
    return inputs


def _judge_counts(inputs: RecordedInputs, journals: dict[str, list[Journal]], n_devices: int) -> None:
    """Refuse journals of far more ticks than device frames were recorded: each of those is one."""
    for name, told in journals.items():
        ticks = sum(max(0, run[1]) for journal in told for run in journal.runs.view().tolist())
        if ticks > 2 * n_devices + _TICKS_AT_LEAST:
            raise RecordingError(f"{inputs.path}: {name} tells of {ticks} ticks, {n_devices} device frames are in it")


class _FirstIncarnation:
    """Tells whether a frame is of the first incarnation of its process, as a restart loses the state."""

    def __init__(self, inputs: RecordedInputs) -> None:
        self._inputs = inputs
        self._incarnations: dict[str, int] = {}

    def __call__(self, recorded: RecordedFrame) -> bool:
        frame = recorded.frame
        if self._incarnations.setdefault(frame.topic, frame.incarnation) == frame.incarnation:
            return True
        self._inputs.ended = f"{frame.topic.partition('.')[0]} was restarted"
        return False


def _ticks(inputs: RecordedInputs, name: str, journals: list[Journal]) -> dict[int, tuple[int, ...]]:
    """Return the facts of each tick of a journal, up to its first gap."""
    found: dict[int, tuple[int, ...]] = {}
    if not journals or journals[0].noted:
        why = f"begins {journals[0].noted} ticks after it" if journals else "is not in it"
        raise RecordingError(f"{inputs.path}: cannot be run again from the simulation's beginning: {name} {why}")
    noted = 0
    for journal in journals:
        if journal.noted != noted:
            inputs.ended = f"{journal.noted - noted} ticks of {name} are missing"
            break
        for first, count, stride, *facts in journal.runs.view().tolist():
            if stride < 1 or not 0 < count <= _LONGEST_RUN:
                raise RecordingError(f"{inputs.path}: a run of {count} ticks, {stride} apart, in {name}")
            noted += count
            found |= dict.fromkeys(range(first, first + count * stride, stride), tuple(facts))
    return found


def _intakes(
    inputs: RecordedInputs,
    devices: dict[int, Frame],
    haptics: dict[int, tuple[int, ...]],
    physics: dict[int, tuple[int, ...]],
) -> Iterator[Intake]:
    if not devices:
        raise RecordingError(f"{inputs.path}: cannot be run again: {_DEVICES} is not in it")
    first, last = min(devices), min(devices[max(devices)].body.tick, max(physics), max(haptics))
    for tick in sorted(each for each in haptics if each <= last):
        age, is_fresh, ahead = haptics[tick]
        frame = devices.get(tick + ahead)
        if frame is None and tick + ahead < first:
            inputs.guessed += not _rests(devices, first)
            body = msgspec.structs.replace(devices[first].body, tick=tick)
            frame = msgspec.structs.replace(devices[first], body=body)
        if frame is None:
            inputs.ended = f"the device frame of tick {tick} is missing"
            return
        ticks, level, _ = physics.get(tick, (0, 0, 0))
        yield Intake(tick, frame, tick - age if age >= 0 else -1, bool(is_fresh), ticks, level)


def _rests(devices: dict[int, Frame], first: int) -> bool:
    """Return whether the hands have not moved since the previous frame, and so probably not since the start."""
    later = devices.get(first + 1)
    if later is None:
        return False
    pairs = zip(devices[first].body.instruments, later.body.instruments, strict=True)
    return all(getattr(a, name) == getattr(b, name) for a, b in pairs for name in _TOLD)
