"""Observation of an attempt from the newest frames of the bus, in a few numbers and words."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from trocar.protocol import Frame, bodies
from trocar.protocol.bodies.physics import ToolReaction
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.training.attempt import Observation
from trocar.services.training.fitness import Fitness
from trocar.services.training.judge import Judge

TOPICS = ("gateway.state", "haptics.contacts", "physics.state")
_CATHETER = 1  # `GraspHold.target_kind` on the wire, else the duct
LATE, STOPPED, ANEW = "the rig was late", "the rig was stopped", "a part of the rig began anew"


class RigObserver:
    """Keeps the newest frames, and quantities derived from them.

    Args:
        spared: Processes of the rig that may be late, as no force depends on them.
        ways, branch: For a branch as the goal: the paths through the duct, and the branch.
        fitness: Whether the machine is good enough; by default of a rig by the clock.

    Attributes:
        begins: int. Number of restarts of the scene, from the gateway; -1 if unknown.
        held: tuple. The body held by each instrument: "catheter", "duct" or empty.
        force_n: float. Largest force on a tool.
        pressed_s: float. How long the first button of a device has been pressed.
    """

    def __init__(
        self,
        spared: Collection[str] = (),
        ways: TubePaths | None = None,
        branch: str = "",
        fitness: Fitness | None = None,
    ) -> None:
        self.fitness = fitness or Fitness()
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

    def take_frames(self, frames: Mapping[str, Frame], now_ns: int) -> None:
        """Process new frames."""
        for name, frame in frames.items():
            if self._by.setdefault(name, frame.incarnation) != frame.incarnation:
                self._by[name] = frame.incarnation
                self._fault = ANEW
            getattr(self, f"_take_{name.partition('.')[0]}")(frame.body)
            if self.judge is not None:
                self.judge.take_frame(name, frame.sent_ns, frame.body)
        pressed = self._gateway is not None and any(each.buttons & 1 for each in self._gateway.instruments)
        self._pressed_ns = (self._pressed_ns or now_ns) if pressed else 0
        self.pressed_s = (now_ns - self._pressed_ns) * 1e-9 if pressed else 0.0

    def release(self) -> None:
        """Restart the time of the pressed button, after executing its command."""
        self._pressed_ns, self.pressed_s = 0, 0.0

    @property
    def gateway(self) -> int:
        """Incarnation of the gateway; a new one does not know earlier orders."""
        return self._by.get("gateway.state", -1)

    def take_rig(self, state: bodies.SupervisorState) -> None:
        """Process the supervisor's state."""
        stopped = state.safe_stop or state.state == "safe_stop"
        late = state.state == "degraded" and state.reason.partition(":")[0] not in self._spared
        self._rig = STOPPED if stopped else LATE if late and not self.fitness.simulated else ""
        self.fitness.take_rig(state, self._spared)

    @property
    def tick(self) -> int:
        """The newest tick of physics, -1 before the first."""
        return self._physics.tick if self._physics is not None else -1

    def observe(self) -> Observation | None:
        """Return the observation of the present scene, None before its first state."""
        gateway, physics = self._gateway, self._physics
        if gateway is None or physics is None or physics.tick < self._began_tick:
            return None
        fault, self._fault = self._fault or self._rig or self.fitness.slow, ""
        return Observation(
            tick=physics.tick,
            depth_m=self._depth_m(physics.catheter),
            hands=tuple((*each.position_m, each.handle_angle_rad) for each in gateway.instruments),
            fault=fault,
            phase=self.judge.phase if self.judge is not None else "",
            errors=self.judge.errors if self.judge is not None else {},
        )

    def _depth_m(self, catheter: bodies.Catheter) -> float:
        """Return the inserted length of the catheter, or the distance of its tip along the path to the goal."""
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
