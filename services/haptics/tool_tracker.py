"""The tools of a device frame as bodies: proxies that contact holds back from the hands, and their segments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from protocol.bodies import GatewayState, InstrumentState, ToolReaction, ToolState
from services.mechanics.bodies.forceps.grasp import JawState
from services.mechanics.bodies.forceps.kinematics import jaw_angle_from_handle
from services.mechanics.bodies.forceps.tool_body import ToolBody
from services.mechanics.scene import SceneModel
from services.mechanics.scene.tools import N_TOOLS

_NO_REACTION = ToolReaction()


class ToolTracker:
    """Follows the hands from device frames and the proxies from physics.

    Between two frames of physics a proxy moves with its hand: what physics knows is the stretch of the coupling.

    Attributes
    ----------
    segments_m : (2, 3, 2, 3), radius_m : (2, 3), present : (2,)
        What collision detection takes.
    reactions
        The newest solved reaction per tool.
    """

    def __init__(self, scene: SceneModel) -> None:
        self._forceps = scene.forceps
        self._body = ToolBody(scene.forceps)
        self._stretch_m = np.zeros((N_TOOLS, 3))
        self._asked_rad = [0.0] * N_TOOLS
        self.segments_m = self._body.segments
        self.radius_m = self._body.radius_m
        self.present = np.zeros(N_TOOLS, np.bool_)
        self.reactions: list[ToolReaction] = [_NO_REACTION] * N_TOOLS

    def update_pose(self) -> None:
        """Recompute the segments from the proxies."""
        self._body.update_pose()

    def take_reactions(self, reactions: Sequence[ToolReaction]) -> None:
        """Take over the solved reactions and the proxies."""
        for i, reaction in enumerate(reactions[:N_TOOLS]):
            self.reactions[i] = reaction
            held = reaction.contacts > 0 or reaction.holds > 0
            for axis in range(3):
                stretch = reaction.proxy_position_m[axis] - reaction.position_m[axis]
                self._stretch_m[i, axis] = stretch if held else 0.0

    def forget_reactions(self) -> None:
        """Physics is silent: no force is known any more."""
        self.reactions = [_NO_REACTION] * N_TOOLS
        self._stretch_m[:] = 0.0

    def take_hands(self, state: GatewayState) -> tuple[ToolState, ...]:
        """Move the tools to a device frame and return them as physics needs them."""
        self.present[:] = False
        tools = tuple(self._hand(i, each) for i, each in enumerate(state.instruments[: len(self._forceps)]))
        self._body.update_pose()
        return tools

    def jaws(self, i: int) -> JawState:
        """Return where the jaws of tool `i` are, and where its handle wants them."""
        return JawState(float(self._body.proxy[i, 3]), self._asked_rad[i])

    def _hand(self, i: int, instrument: InstrumentState) -> ToolState:
        forceps, body = self._forceps[i], self._body
        jaw = jaw_angle_from_handle(instrument.handle_angle_rad, forceps.jaw_ratio, forceps.jaw_max_angle_rad)
        self.present[i] = True
        body.port_m[i] = instrument.port_m
        body.roll_rad[i] = instrument.roll_rad
        body.proxy[i, :3] = instrument.position_m
        body.proxy[i, :3] += self._stretch_m[i]
        self._asked_rad[i] = jaw
        reaction = self.reactions[i]  # what is between the jaws keeps them open
        body.proxy[i, 3] = reaction.proxy_jaw_angle_rad if reaction.contacts or reaction.holds else jaw
        return ToolState(
            position_m=instrument.position_m,
            port_m=instrument.port_m,
            roll_rad=instrument.roll_rad,
            jaw_angle_rad=jaw,
        )
