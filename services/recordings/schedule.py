"""The order of inputs of haptics and physics, for processes that repeat it over the bus.

Each waits for the inputs of the recording, and uses no others. So delays only delay the replay, and do not change it.
"""

from __future__ import annotations

from dataclasses import dataclass

from trocar.protocol.topics import TICK_S
from trocar.services.recordings.inputs import Intake, RecordedInputs, read_inputs
from trocar.services.runtime.config.rig import ReplaySettings

#: Period of repeating an unanswered frame, as a process that has just started may have missed it: longer than a tick
#: takes even on a busy machine.
ASK_AGAIN_NS = 20_000_000


@dataclass(frozen=True, slots=True)
class Schedule:
    """Inputs at each tick, and the last tick before it whose contacts physics used.

    Ticks that are not in it are new, and follow the hands live.
    """

    intakes: dict[int, Intake]
    awaited: dict[int, int]


def read_schedule(settings: ReplaySettings) -> Schedule:
    """Return the schedule of a recording, up to the end of the replay.

    Raises RecordingError if it cannot be replayed.
    """
    inputs = read_inputs(settings.file)
    inputs.check_scene()
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
