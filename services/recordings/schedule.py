"""The order in which haptics and physics took what they took, for processes that repeat it over the bus.

Each waits for what it took when the recording was made, and takes nothing else. So whatever is late makes the replay
late, and changes nothing in it.
"""

from __future__ import annotations

from dataclasses import dataclass

from protocol.topics import TICK_S
from services.recordings.inputs import Intake, RecordedInputs, read_inputs
from services.runtime.rig import ReplaySettings

#: Who waits for an answer asks again after so long: a process that has just started has not heard the question.
ASK_AGAIN_NS = 20_000_000


@dataclass(frozen=True, slots=True)
class Schedule:
    """What was taken in at each tick, and the last tick before whose contacts physics took.

    Ticks that are not in it are new: from then on hands are followed as they come.
    """

    intakes: dict[int, Intake]
    awaited: dict[int, int]


def read_schedule(settings: ReplaySettings) -> Schedule:
    """Return the schedule of a recording, up to where the replay is to end.

    Raises RecordingError if it cannot be run again.
    """
    inputs = read_inputs(settings.file)
    inputs.check_mechanics()
    awaited, taken = {}, -1
    intakes = replayed(inputs, settings.until_s)
    for intake in intakes:
        awaited[intake.tick] = taken
        taken = intake.tick if intake.ticks else taken
    return Schedule({intake.tick: intake for intake in intakes}, awaited)


def replayed(inputs: RecordedInputs, until_s: float | None) -> list[Intake]:
    """Return the ticks up to a time since the first one."""
    if until_s is None:
        return inputs.intakes
    end = inputs.intakes[0].tick + round(until_s / TICK_S)
    return [intake for intake in inputs.intakes if intake.tick <= end]
