"""What the newest frames of the bus say of an attempt, in a few numbers and words."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from protocol import Frame, bodies
from protocol.bodies.physics import ToolReaction
from services.training.attempt import Look
from services.training.judge import Judge
from services.tube_paths import TubePaths

TOPICS = ("gateway.state", "haptics.contacts", "physics.state")
_CATHETER = 1
LATE, STOPPED, ANEW = "the rig was late", "the rig was stopped", "a part of the rig began anew"


class Sight:
    """Keeps the newest frames, and what they tell.

    Args:
        spared: Processes of the rig that may be late, as no force waits for them.
        ways, branch: Where the goal is a branch: the ways through the duct, and which of them.

    Attributes:
        begins: int. How often the scene was begun again, as the gateway says; -1 not known yet.
        held: tuple. Of each instrument what it holds: "catheter", "duct" or nothing.
        force_n: float. Largest force on a tool.
        pressed_s: float. For how long the first button of a device has been pressed.
    """

    def __init__(self, spared: Collection[str] = (), ways: TubePaths | None = None, branch: str = "") -> None:
        self._spared = frozenset(spared)
        self._ways, self._branch = ways, branch
        self.begins = -1
        self.held: tuple[str, ...] = ()
        self.force_n = self.pressed_s = 0.0
        self.judge: Judge | None = None
        self._gateway: bodies.GatewayState | None = None
        self._physics: bodies.PhysicsState | None = None
        self._began_tick = 0
        self._by: dict[str, int] = {}
        self._fault = ""
        self._rig = ""
        self._pressed_ns = 0

    def take(self, frames: Mapping[str, Frame], now_ns: int) -> None:
        """Take what came."""
        for name, frame in frames.items():
            if self._by.setdefault(name, frame.incarnation) != frame.incarnation:
                self._by[name] = frame.incarnation
                self._fault = ANEW
            getattr(self, f"_take_{name.partition('.')[0]}")(frame.body)
            if self.judge is not None:
                self.judge.take(name, frame.sent_ns, frame.body)
        pressed = self._gateway is not None and any(each.buttons & 1 for each in self._gateway.instruments)
        self._pressed_ns = (self._pressed_ns or now_ns) if pressed else 0
        self.pressed_s = (now_ns - self._pressed_ns) * 1e-9 if pressed else 0.0

    def release(self) -> None:
        """Take the button as pressed from now on: what it asked for is done."""
        self._pressed_ns, self.pressed_s = 0, 0.0

    @property
    def gateway(self) -> int:
        """Which gateway speaks: another one knows of nothing that was asked of this one."""
        return self._by.get("gateway.state", -1)

    def take_rig(self, state: bodies.SupervisorState) -> None:
        """Take what the supervisor says of the rig."""
        stopped = state.safe_stop or state.state == "safe_stop"
        late = state.state == "degraded" and state.reason.partition(":")[0] not in self._spared
        self._rig = STOPPED if stopped else LATE if late else ""

    def look(self) -> Look | None:
        """Return what is seen of the scene that was begun last; None while nothing is."""
        gateway, physics = self._gateway, self._physics
        if gateway is None or physics is None or physics.tick < self._began_tick:
            return None
        fault, self._fault = self._fault or self._rig, ""
        return Look(
            tick=physics.tick,
            depth_m=self._depth_m(physics.catheter),
            hands=tuple((*each.position_m, each.handle_angle_rad) for each in gateway.instruments),
            fault=fault,
            phase=self.judge.phase if self.judge is not None else "",
            errors=self.judge.errors if self.judge is not None else {},
        )

    def _depth_m(self, catheter: bodies.Catheter) -> float:
        """Return how much of the catheter is in the lumen, or how far its tip has come on the way to the goal."""
        inserted_m = catheter.inserted_length_m
        if self._ways is None or not self._branch or inserted_m == 0.0:
            return inserted_m
        return self._ways.progress_m(catheter.position_m.view()[-1], self._branch)

    def _take_gateway(self, body: bodies.GatewayState) -> None:
        if body.begins != self.begins or body.tick < self._began_tick:
            self._began_tick = body.tick if self.begins >= 0 else 0
            self.begins = body.begins
        self._gateway = body

    def _take_haptics(self, body: bodies.ToolContacts) -> None:
        kinds = {hold.tool: "catheter" if hold.target_kind == _CATHETER else "duct" for hold in body.holds}
        self.held = tuple(kinds.get(tool, "") for tool in range(body.tools.shape[0]))

    def _take_physics(self, body: bodies.PhysicsState) -> None:
        self._physics = body
        reactions: tuple[ToolReaction, ...] = body.reactions()
        self.force_n = max((math.hypot(*each.force_n) for each in reactions), default=0.0)
