"""The session with one arm of the service."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from trocar.services.gateway.devices.asked_arm import ArmAnswer, ArmConnection
from trocar.services.gateway.haply.channel import Channel
from trocar.services.gateway.haply.grip import Grip
from trocar.services.gateway.haply.messages import ArmEntry, Filters, GravitySetting, Told, force_message, understand
from trocar.services.runtime.config.rig import Vector3

#: Answers of a tick that are looked at, the newest: one is usual, and after a stop the older ones are of no use, as
#: only the newest place counts.
_MOST = 8


class ArmLink(ArmConnection):
    """Exchanges with an arm that was found and set.

    Args:
        key, identity: Where the service lists the arm, and as what.
        grip: The grip that turns the tool, with its identity, or None.
        centre_m: The middle of the workspace, in the service's axes.
        shown: How sentences name the arm.
        in_force: What the service adds to forces.

    Attributes:
        on_close: Called when the session ends.
    """

    on_close: Callable[[], None] | None = None

    def __init__(
        self,
        channel: Channel,
        key: str,
        identity: str,
        grip: tuple[str, Grip] | None,
        centre_m: Vector3,
        shown: str,
        in_force: tuple[GravitySetting, Filters],
    ) -> None:
        self._channel, self._key, self._identity, self._grip = channel, key, identity, grip
        self._centre_m, self._shown = centre_m, shown
        self._asked: deque[int] = deque()
        self._broken = ""
        self._strange = 0
        self._gravity, self._filters = in_force

    @property
    def outstanding(self) -> int:
        """How many messages have no answer yet."""
        return len(self._asked)

    @property
    def lost(self) -> str:
        """Why there will be no more answers."""
        if self._broken:
            return self._broken
        return f"Haply's service is gone ({self._channel.lost}); arm the rig to try again" if self._channel.lost else ""

    def gauges(self) -> dict[str, float]:
        """Return what the service itself adds to forces, and how many of its answers were not understood."""
        return {
            "gravity_compensation": self._gravity.scaling_factor if self._gravity.enabled else 0.0,
            "force_gate_gain": self._filters.force_gate.gain,
            "damping_n_s_m": self._filters.damping.scalar,
            "strange_answers": float(self._strange),
        }

    def ask_state(self, force_n: Vector3, now_ns: int) -> None:
        """Send a force, which the service gives the arm once."""
        toward, right, up = force_n
        self._asked.append(now_ns)
        self._channel.send(force_message(self._key, self._identity, (right, -toward, up)))

    def answers(self, now_ns: int) -> list[ArmAnswer]:
        """Return what the newest messages tell of the arm."""
        asked = []
        for message in self._channel.receive():
            if not self._asked:
                self._broken = "Haply's service says more than it was asked, so nothing tells how old its answers are"
                return []
            asked.append((self._asked.popleft(), message))
        return [self._answer(asked_ns, understand(message)) for asked_ns, message in asked[-_MOST:]]

    def close(self) -> None:
        """End the session, after which the service lets the arm go."""
        self._channel.close()
        if self.on_close is not None:
            self.on_close()
        self.on_close = None

    def _answer(self, asked_ns: int, told: Told | None) -> ArmAnswer:
        if told is None:
            self._strange += 1
            return ArmAnswer(asked_ns, problem="Haply's service answers in another format")
        arm = told.arm(self._identity)
        if arm is None:
            problem = f"{self._shown} is not plugged in: Haply's service does not list it"
            return ArmAnswer(asked_ns, problem=problem, limp=True)
        prompt = self._hold_grip(told, asked_ns)
        roll, buttons = (None, 0) if self._grip is None else (self._grip[1].roll_rad, self._grip[1].buttons)
        problem = _find_problem(arm, self._shown)
        place = None if problem else self._place(arm)
        return ArmAnswer(asked_ns, place, roll, buttons, arm.status.calibrated, problem, prompt, limp=bool(problem))

    def _hold_grip(self, told: Told, asked_ns: int) -> str:
        if self._grip is None:
            return ""
        identity, grip = self._grip
        grip.take_entry(told.grip(identity), asked_ns)
        asleep = f"the grip {identity} sleeps or is away, so its tool does not turn: press one of its buttons"
        return "" if grip.awake else asleep

    def _place(self, arm: ArmEntry) -> Vector3 | None:
        said = arm.state.cursor_position
        place = None if said is None else said.complete()
        if place is None:
            return None
        x, y, z = (part - middle for part, middle in zip(place, self._centre_m, strict=True))
        return (-y, x, z)


def _find_problem(arm: ArmEntry, shown: str) -> str:
    if arm.status.power_supply is False:
        return f"{shown} has no power: plug in its supply"
    if arm.status.ready is False:
        return f"{shown} is not ready"
    return ""
