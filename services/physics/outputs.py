"""What physics publishes of a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from protocol import Frame
from protocol.arrays import pack
from protocol.bodies import Catheter, Duct, PhysicsContacts, ToolReaction
from protocol.vectors import Vec3
from services.mechanics.contact.pairs import NO_TOOL
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.solver import HOLD
from services.mechanics.simulation import Simulation
from services.mechanics.tools import N_TOOLS
from services.runtime.bus import Bus

Mask = NDArray[np.bool_]

_INSERTED_EVERY = 16
_NO_TWIST = pack(np.zeros(0))


class Outputs:
    """Publishes the state of one simulation."""

    def __init__(self, simulation: Simulation, basis_hash: str) -> None:
        self._simulation = simulation
        self._basis_hash = basis_hash
        self._inserted_m = 0.0

    def publish(self, bus: Bus, answered: Frame, *, valid: bool) -> None:
        """Send duct, catheter and contacts, as the answer to one frame of tools."""
        tick, valid = answered.body.tick, valid and answered.valid
        # Contacts first: the hand waits for the forces, the rest can follow.
        bus.publish("physics.contacts", self._contacts(tick, answered), origin_ns=answered.origin_ns, valid=valid)
        bus.publish("physics.duct", self._duct(tick), origin_ns=answered.origin_ns, valid=valid)
        bus.publish("physics.catheter", self._catheter(tick), origin_ns=answered.origin_ns, valid=valid)

    def _duct(self, tick: int) -> Duct:
        s = self._simulation
        return Duct(
            tick=tick,
            basis_hash=self._basis_hash,
            q=pack(s.duct_state.q),
            q_rate=pack(s.duct_state.qdot),
            load_node=pack(s.load_nodes[: s.n_loads], "<i4"),
            load_force_n=pack(s.load_force_n[: s.n_loads]),
            quality_level=s.quality_level,
        )

    def _catheter(self, tick: int) -> Catheter:
        catheter = self._simulation.catheter
        return Catheter(
            tick=tick,
            position_m=pack(catheter.state.position_m),
            velocity_m_s=pack(catheter.state.velocity_m_s),
            radius_m=catheter.radius_m,
            twist_rad=_NO_TWIST,
            inserted_length_m=self._inserted_length_m(tick),
        )

    def _inserted_length_m(self, tick: int) -> float:
        """Return what the picture and the score read; at 60 Hz, for it costs as much as a tenth of a step."""
        if tick % _INSERTED_EVERY == 0:
            self._inserted_m = self._simulation.inserted_length_m
        return self._inserted_m

    def _contacts(self, tick: int, answered: Frame) -> PhysicsContacts:
        s = self._simulation
        rows = s.contacts
        n = rows.n_contacts
        tools, forces = rows.tool[:n], s.contact_force_n
        pressed: Mask = np.asarray(forces.any(axis=1))
        held: Mask = np.asarray(rows.kind[:n] == HOLD)
        return PhysicsContacts(
            tick=tick,
            tools=tuple(
                self._tool(i, tool.position_m, np.equal(tools, i), pressed, held)
                for i, tool in enumerate(answered.body.tools[:N_TOOLS])
            ),
            kind=pack(_kinds(rows), "|i1"),
            point_m=pack(rows.point_m[:n]),
            force_n=pack(forces),
            max_penetration_m=s.max_penetration_m,
        )

    def _tool(self, i: int, position_m: Vec3, of_tool: Mask, pressed: Mask, held: Mask) -> ToolReaction:
        results = self._simulation.tool_results
        return ToolReaction(
            force_n=_vector(results.force_n[i]),
            torque_nm=_vector(results.torque_nm[i]),
            port_moment_nm=_vector(results.port_moment_nm[i]),
            grasp_torque_nm=float(results.grasp_torque_nm[i]),
            stiffness_n_m=tuple(results.stiffness_n_m[i].ravel().tolist()),
            position_m=position_m,
            proxy_position_m=_vector(results.proxy_position_m[i]),
            proxy_jaw_angle_rad=float(results.proxy_jaw_angle_rad[i]),
            contacts=int((of_tool & pressed & ~held).sum()),
            holds=int((of_tool & held).sum()),
        )


def _kinds(rows: ContactRows) -> NDArray[np.int8]:
    """Return 0 tool-duct, 1 tool-catheter, 2 catheter-duct, 3 other for each row."""
    n = rows.n_contacts
    of_tool, on_duct = rows.tool[:n] != NO_TOOL, rows.duct_weight[:n].any(axis=1)
    return np.where(of_tool, np.where(on_duct, 0, 1), np.where(on_duct, 2, 3)).astype(np.int8)


def _vector(values: NDArray[np.float64]) -> Vec3:
    x, y, z = values.tolist()
    return x, y, z
