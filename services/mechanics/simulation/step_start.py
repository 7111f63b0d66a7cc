"""What a step begins with: noted, and put back where the step is to be taken again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from services.mechanics.compiled.memory import copy_arrays, copy_table
from services.mechanics.world import World


class NotesItsStart(Protocol):
    """Keeps more of a step's start than arrays."""

    def note_start(self) -> None:
        """Note what a step begins with."""

    def put_back_start(self) -> None:
        """Begin with that again."""


class StepStart:
    """All that a step goes on from, until it has ended: a try that is taken back leaves nothing.

    What a step only writes at its end, when nothing takes it back any more, needs no note. Nor does what each try
    writes anew before it reads it.
    """

    def __init__(self, world: World, tools: Sequence[NotesItsStart]) -> None:
        live = [*world.seal.step_arrays(), *(array for effect in world.effects for array in effect.state_arrays())]
        for part in (world.duct, world.catheter, world.tools, world.system, world.holds):
            live += part.step_arrays()
        self._kept = [array.copy() for array in live]
        self._note, self._put_back = copy_table(self._kept, live), copy_table(live, self._kept)
        self._noting: list[NotesItsStart] = [world.catheter, world.system, world.holds, *tools]
        self._search = world.search

    def note(self) -> None:
        """Note what the next step begins with."""
        copy_arrays(self._note)
        for part in self._noting:
            part.note_start()

    def put_back(self) -> None:
        """Begin with it again."""
        copy_arrays(self._put_back)
        for part in self._noting:
            part.put_back_start()
        self._search.put_back_start()
