"""Saves the state at the start of a step, and restores it where the step is to be repeated."""

from __future__ import annotations

from collections.abc import Sequence

from trocar.services.mechanics.arrays import AnyArray, FloatArray
from trocar.services.mechanics.compiled.memory import SavedArrays
from trocar.services.mechanics.world import RestartablePart, World


class StepStart:
    """The complete state at the start of a step, so that a rejected step leaves no trace.

    So nothing is felt of it either: ``tool_force`` is that on the tools. Arrays that are written only at the end of an
    accepted step, or overwritten before they are read, are not saved.
    """

    def __init__(self, world: World, tools: Sequence[RestartablePart], tool_force: FloatArray) -> None:
        live = [
            tool_force,
            *world.squeeze.step_arrays(),
            *world.seal.step_arrays(),
            *(array for effect in world.effects for array in effect.step_arrays()),
        ]
        for part in (world.duct, world.catheter, world.tools, world.system, world.holds):
            live += part.step_arrays()
        self._arrays = SavedArrays(live)
        self._parts: list[RestartablePart] = [world.catheter, world.system, world.holds, *tools]
        self._parts += [saved for effect in world.effects if (saved := effect.restartable) is not None]
        self._search = world.search

    def saved(self, array: AnyArray) -> AnyArray:
        """Return the copy of a live array at the start of the step."""
        return self._arrays.saved(array)

    def save(self) -> None:
        """Save the state at the start of the next step."""
        self._arrays.save()
        for part in self._parts:
            part.save_start()

    def restore(self) -> None:
        """Restore the saved state."""
        self._arrays.restore()
        for part in self._parts:
            part.restore_start()
        self._search.restore_start()
