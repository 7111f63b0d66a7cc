"""Grasps of an environment's tools by the rig's haptics, from an episode's devices and states."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trocar.protocol.bodies import PhysicsState
from trocar.protocol.bodies.haptics import tool_table
from trocar.services.haptics.grasping import Grasping
from trocar.services.haptics.instruments import HANDLE_RATE, INSTRUMENT_COLUMNS, PORT, ROLL
from trocar.services.haptics.reactions import Reactions
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import N_TOOLS, GraspHold


class Grips:
    """Haptics without force models: poses of the jaws, their contacts while they close, and their holds.

    Attributes:
        hands: Array. The tools' table for physics from the last look.
        holds: list of GraspHold. A live list.
        reactions: Reactions. Reactions on the tools, which a `Framer` writes after each step.
    """

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        self._n_tools = len(scene.forceps)
        self._instruments = np.zeros((N_TOOLS, INSTRUMENT_COLUMNS))
        for row, forceps in zip(self._instruments, scene.forceps, strict=False):
            row[PORT : PORT + 3] = forceps.port_position_m
        self.reactions = Reactions()
        self._grasping = Grasping(scene, duct, self.reactions.rows, self._instruments)
        self.begin_again()

    def begin_again(self) -> None:
        """Release all holds and clear the solved state."""
        self._grasping.begin_again()
        self.reactions.forget()
        self.hands, self.holds = tool_table(()), list[GraspHold]()

    def follow_hands(self, state: FloatArray, newest: Callable[[], PhysicsState] | None) -> list[GraspHold]:
        """Return the holds of the tools for this state of their devices (2, 5).

        ``newest`` returns the last solved state, and is called only while jaws close; None before the first step.
        """
        self._instruments[:, :3], self._instruments[:, ROLL:HANDLE_RATE] = state[:, :3], state[:, 3:]
        self.hands = self._grasping.follow_hands(self._n_tools)
        if newest is not None and self._grasping.closing:
            self._grasping.update_shapes(newest())
        self.holds = self._grasping.update()
        return self.holds

    @property
    def has_catheter(self) -> bool:
        """Whether a tool holds the catheter."""
        return any(hold.target_kind == CATHETER_SEGMENT for hold in self.holds)
