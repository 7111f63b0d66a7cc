"""The solved reactions as a table for kernels, one row per tool."""

from __future__ import annotations

import numpy as np

from trocar.protocol.arrays import Array
from trocar.protocol.bodies.physics import REACTION_CONTACTS, REACTION_HOLDS, ToolReaction
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.runtime.loop.flat_view import flat_view


class Reactions:
    """The newest solved reaction of each tool.

    Attributes:
        rows: (2, REACTION_COLUMNS) float64
    """

    def __init__(self) -> None:
        self._none = np.array([ToolReaction().row()] * N_TOOLS)
        self.rows: FloatArray = self._none.copy()
        self._bytes = flat_view(self.rows).cast("B")

    def take_table(self, table: Array) -> None:
        """Copy a table (n, REACTION_COLUMNS), and reset the rows of tools beyond it."""
        data = table.data
        if len(data) > len(self._bytes):
            data = data[: len(self._bytes)]
        elif len(data) < len(self._bytes):
            self.forget()
        self._bytes[: len(data)] = data

    def forget(self) -> None:
        """Reset all rows, because physics is silent."""
        self.rows[:] = self._none


@kernel
def is_held(reactions: FloatArray, tool: int) -> bool:
    """Return whether a tool has a contact or a hold."""
    return bool(reactions[tool, REACTION_CONTACTS] > 0.0 or reactions[tool, REACTION_HOLDS] > 0.0)
