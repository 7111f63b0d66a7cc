"""Frames of the rig's bus for what happens in an environment: judged, drawn and recorded as those of a rig."""

from __future__ import annotations

import msgspec

from protocol import PROTOCOL_VERSION, TOPICS, Frame
from protocol.arrays import Array
from protocol.bodies import GatewayState, InstrumentState, ToolContacts
from protocol.bodies.haptics import ToolState, tool_table
from services.haptics.outputs import hold_body
from services.mechanics.arrays import FloatArray
from services.mechanics.simulation import Simulation
from services.physics.outputs import Outputs
from trocar.envs.hands import DeviceHands

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
"""Of what is said in one tick."""
_MEASURED_EVERY = 16
"""Ticks, as in `services.physics.outputs`."""


class Framer:
    """Makes frames of one episode, whose clock is that of the simulation.

    A body is of the tick at whose end the hands are where it says.
    """

    def __init__(self, simulation: Simulation, hands: DeviceHands) -> None:
        self._simulation, self._hands = simulation, hands
        self._outputs = Outputs(simulation, simulation.duct.reduced.basis.content_hash)
        self._sequences: dict[str, int] = {}
        self._period = 0

    def frame(self, tick: int, body: msgspec.Struct, topic: str) -> Frame:
        """Return a frame of what is said at the end of a tick."""
        sequence = self._sequences[topic] = self._sequences.get(topic, -1) + 1
        sent_ns = (tick + 1) * TICK_NS + _ORDER.index(topic)
        origin_ns = (tick + 1) * TICK_NS
        return Frame(PROTOCOL_VERSION, topic, TOPICS[topic].version, 1, sequence, sent_ns, origin_ns, True, body)

    def devices(self, tick: int, at: FloatArray) -> Frame:
        """Return the frame of the devices where their state is ``at`` (2, 5)."""
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
        """Return the frames of the tools with what they hold, and of the state."""
        tools = self._tools()
        holds = tuple(hold_body(hold) for grasp in self._simulation.grasps for hold in grasp.holds)
        contacts = ToolContacts(tick=tick, tools=tools, holds=holds)
        state = self._outputs.state(tick, tools)
        return self.frame(tick, contacts, "haptics.contacts"), self.frame(tick, state, "physics.state")

    def settle(self, tick: int) -> None:
        """Measure the inserted length where physics does it after this tick: so frames are the same to the bit."""
        period = max(1, tick // _MEASURED_EVERY)
        if period != self._period:
            self._period = period
            self._outputs.forget()
            self._outputs.settle()

    def _tools(self) -> Array:
        inputs, scene = self._hands.inputs, self._simulation.scene
        rows = [
            ToolState(
                position_m=tuple(inputs.position_m[k].tolist()),
                port_m=scene.forceps[k].port_position_m,
                roll_rad=float(inputs.roll_rad[k]),
                jaw_angle_rad=float(inputs.jaw_angle_rad[k]),
            )
            for k in range(self._hands.n_tools)
        ]
        return tool_table(rows)
