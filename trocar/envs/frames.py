"""Frames of the rig's bus for an environment's episode, to be judged, drawn and recorded like those of a rig."""

from __future__ import annotations

import msgspec

from trocar.envs.grips import Grips
from trocar.envs.hands import DeviceHands
from trocar.protocol import PROTOCOL_VERSION, TOPICS, Frame
from trocar.protocol.bodies import GatewayState, InstrumentState, PhysicsState, ToolContacts
from trocar.services.haptics.outputs import hold_body
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.simulation import Simulation
from trocar.services.physics.outputs import Outputs

TICK_NS = 1_000_000
NAMES = ("right", "left")
_ORDER = (
    "gateway.state",
    "haptics.contacts",
    "physics.state",
    "training.attempt",
    "haptics.journal",
    "physics.journal",
)
"""Topics of the frames in a tick."""
_MEASURED_EVERY = 16
"""Ticks, as in `trocar.services.physics.outputs`."""


class Framer:
    """Makes the frames of one episode, with the simulation's clock.

    A body is of the tick at whose end the hands have its state.
    """

    def __init__(self, simulation: Simulation, grips: Grips, hands: DeviceHands) -> None:
        self._simulation, self._grips, self._hands = simulation, grips, hands
        self._outputs = Outputs(simulation, simulation.duct.reduced.basis.content_hash, grips.reactions.rows)
        self._sequences: dict[str, int] = {}
        self._period = 0

    def frame(self, tick: int, body: msgspec.Struct, topic: str) -> Frame:
        """Return a frame at the end of a tick."""
        sequence = self._sequences[topic] = self._sequences.get(topic, -1) + 1
        sent_ns = (tick + 1) * TICK_NS + _ORDER.index(topic)
        origin_ns = (tick + 1) * TICK_NS
        return Frame(PROTOCOL_VERSION, topic, TOPICS[topic].version, 1, sequence, sent_ns, origin_ns, True, body)

    def devices(self, tick: int, at: FloatArray) -> Frame:
        """Return the frame of the devices in state ``at`` (2, 5)."""
        hands, scene = self._hands, self._simulation.scene
        instruments = tuple(
            InstrumentState(
                name=NAMES[k],
                position_m=(state[0], state[1], state[2]),
                velocity_m_s=(rate[0], rate[1], rate[2]),
                handle_angle_rad=state[4],
                handle_rate_rad_s=rate[4],
                port_m=scene.forceps[k].port_position_m,
                roll_rad=state[3],
            )
            for k, (state, rate) in enumerate(zip(at[: hands.n_tools].tolist(), hands.rate.tolist(), strict=False))
        )
        return self.frame(tick, GatewayState(tick=tick, instruments=instruments), "gateway.state")

    def solved(self, tick: int) -> tuple[Frame, Frame]:
        """Return the frames of the tools with their holds, and of the state of physics."""
        holds = tuple(map(hold_body, self._grips.holds))
        contacts = ToolContacts(tick=tick, tools=self._grips.hands, holds=holds)
        return self.frame(tick, contacts, "haptics.contacts"), self.frame(tick, self.state(tick), "physics.state")

    def state(self, tick: int) -> PhysicsState:
        """Return the state of physics after a step."""
        return self._outputs.state(tick, self._grips.hands)

    def feel(self) -> None:
        """Pass the reactions on the tools after a step to the grips."""
        self._outputs.feel(self._grips.hands)

    def measure_inserted(self, tick: int, last: int) -> None:
        """Measure the inserted length if physics does so after this tick, so that frames are equal to the bit.

        It is skipped if that happens again up to ``last``, as no frame is used before.
        """
        period = max(1, tick // _MEASURED_EVERY)
        if period != self._period and period == max(1, last // _MEASURED_EVERY):
            self._period = period
            self._outputs.forget()
            self._outputs.measure_inserted()
