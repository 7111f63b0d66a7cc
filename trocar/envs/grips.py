"""What the tools of an environment hold: the grasps of the rig's haptics, fed with devices and states of an episode."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from protocol.bodies import PhysicsState
from protocol.bodies.haptics import tool_table
from services.haptics.grasping import Grasping
from services.haptics.instruments import HANDLE_RATE, INSTRUMENT_COLUMNS, PORT, ROLL
from services.haptics.reactions import Reactions
from services.mechanics.arrays import FloatArray
from services.mechanics.collision.pairs import CATHETER_SEGMENT
from services.mechanics.reduction import ReducedDuct
from services.mechanics.scene import SceneModel
from services.mechanics.scene.tools import N_TOOLS, GraspHold


class Grips:
    """Haptics without a model of force: where the jaws are, what they touch where they close, and what they hold.

    Attributes:
        hands: Array. The tools of the last look, as physics is told of them.
        holds: list of GraspHold. Live.
        reactions: Reactions. What tools feel, which a `Framer` writes after each step.
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
        """Hold nothing; nothing has been solved."""
        self._grasping.begin_again()
        self.reactions.forget()
        self.hands, self.holds = tool_table(()), list[GraspHold]()

    def look(self, state: FloatArray, newest: Callable[[], PhysicsState] | None) -> list[GraspHold]:
        """Return what tools hold whose devices are in this state (2, 5).

        ``newest`` packs what was solved last, None before the first step, and is asked only where jaws close.
        """
        self._instruments[:, :3], self._instruments[:, ROLL:HANDLE_RATE] = state[:, :3], state[:, 3:]
        self.hands = self._grasping.follow(self._n_tools)
        if newest is not None and self._grasping.closing:
            self._grasping.update_shapes(newest())
        self.holds = self._grasping.update()
        return self.holds

    @property
    def has_catheter(self) -> bool:
        """Whether a tool holds the catheter."""
        return any(hold.target_kind == CATHETER_SEGMENT for hold in self.holds)
