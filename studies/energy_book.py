"""Energy books of a simulation: what the hands put in, what is stored, and where the rest went.

Every entry is taken from its own quantity, never as the difference of others, so that the books can fail to balance.
They allocate and evaluate forces again: for tests and studies, not for the 1 kHz step.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from time import thread_time_ns

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, FloatArray
from trocar.services.mechanics.bodies.wire_drive import WireMotion
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.contact.laws import HAS_FRICTION, number_of
from trocar.services.mechanics.reduction import ModalState
from trocar.services.mechanics.rod import ImplicitIntegrator, RodState
from trocar.services.mechanics.rod.energy import RodEnergy, rod_energy
from trocar.services.mechanics.rod.model import RodModel, RodWork, allocate_work
from trocar.services.mechanics.rod.twist import add_frame_forces
from trocar.services.mechanics.scene.tools import N_TOOLS, ToolInputs
from trocar.services.mechanics.simulation.simulation import Simulation
from trocar.services.mechanics.world import World
from trocar.studies.grip_energy import Grips, enter_grips, stored_in_grips
from trocar.studies.rod_forces import internal_forces

_PULL = number_of("pull")


@dataclass(slots=True)
class EnergyFlow:
    """Energy in J since the books were opened; everything but ``input_j`` and ``stored_j`` is dissipated.

    Attributes:
        input_j: Work of the hands on the couplings and jaws, by rolling them against the moment of contacts about the
            shaft, of a drive that twists and steers, and of whoever closes a clip.
        stored_j: Change of everything stored: kinetic, elastic, in couplings and grips, and by effects.
        coupling_j: Dampers of the virtual couplings.
        rod_j: Damping of the catheter's material and its drag.
        duct_j: Damping of the modes.
        friction_j: Sliding in contacts and in the introducer, and slipping holds.
        effects_j: What effects say that they dissipate.
        impact_j: Normal forces over the approach in the tick of a touch; negative where an overlap is pushed out.
        healing_j: What was stored at the end of a part after which a caller has set an impossible state, less what is
            stored at its start, at rest.
        withheld_j: What parts of steps have lost that kept only a share of their motion.
        released_j: What holds had stored that were let go, and couplings of tools that came back elsewhere; less what
            holds come back with that had found no row for a while.
        numerical_j: What implicit steps take out: of the catheter, the couplings, the grips, the residual compliance
            and a wall that is squeezed, with what that loses where it slides out from between jaws.
    """

    input_j: float = 0.0
    stored_j: float = 0.0
    coupling_j: float = 0.0
    rod_j: float = 0.0
    duct_j: float = 0.0
    friction_j: float = 0.0
    effects_j: float = 0.0
    impact_j: float = 0.0
    released_j: float = 0.0
    numerical_j: float = 0.0
    healing_j: float = 0.0
    withheld_j: float = 0.0

    @property
    def dissipated_j(self) -> float:
        """Sum of all that was dissipated."""
        return sum(float(getattr(self, f.name)) for f in fields(self)[2:])

    @property
    def imbalance_j(self) -> float:
        """Input less stored less dissipated: zero if the books balance."""
        return self.input_j - self.stored_j - self.dissipated_j


class EnergyBook:
    """Steps a simulation and keeps its books.

    Attributes:
        flow: EnergyFlow
        tick_ns: int. Processor time of the last step, without that of the books.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.flow = EnergyFlow()
        self._model: RodModel = implicit_integrator(simulation).model
        self._work = allocate_work(len(simulation.catheter.state.position_m))
        self._rod = catheter_energy(simulation.world, self._work)
        self._begun: _Snapshot | None = None
        self._opening_j = self._stored_j()
        self._healed_states = simulation.healed_states
        self.tick_ns = self._own_ns = 0

    def step(self, tools: ToolInputs, dt_s: float = 1e-3) -> None:
        """Take one step of the simulation and enter it."""
        self.simulation.watcher, self._own_ns = self, 0
        start_ns = thread_time_ns()
        self.simulation.step(tools, dt_s)
        self.tick_ns = thread_time_ns() - start_ns - self._own_ns
        self.simulation.watcher = None
        if self.simulation.healed_states > self._healed_states:
            self._healed_states = self.simulation.healed_states
            self._enter_healing()

    def _enter_healing(self) -> None:
        """Enter that a world was put back to the start of its last part, whose flows were felt and stay."""
        self._begun = None
        self._rod = catheter_energy(self.simulation.world, self._work)
        stored_j = self._stored_j() - self._opening_j
        self.flow.healing_j += self.flow.stored_j - stored_j
        self.flow.stored_j = stored_j

    def begin(self) -> None:
        """Note what a part of a step begins with."""
        start_ns = thread_time_ns()
        self._begin()
        self._own_ns += thread_time_ns() - start_ns

    def end(self, dt_s: float) -> None:
        """Enter a part of a step."""
        start_ns = thread_time_ns()
        self._end(dt_s)
        self._own_ns += thread_time_ns() - start_ns

    def _begin(self) -> None:
        """Note what a part of a step begins with; rates that a change of its length has moved are entered.

        A part that is begun again has the rows of the try that was taken back: what they store is as it was.
        """
        again = self._begun
        stored_j = self._stored_j() - self._opening_j
        self.flow.numerical_j += self.flow.stored_j - stored_j
        self.flow.stored_j = stored_j
        self._before = self._begun = _Snapshot.of(self.simulation, self._rod, again)
        self._slipped_j = _slipped_j(self.simulation)
        self._spent_j = _dissipated_by_effects_j(self.simulation)
        self._relaxed_s = _relaxed_s(self.simulation)
        self._squeezed_j = self.simulation.squeeze.arrays.dissipated_j

    def _end(self, dt_s: float) -> None:
        """Enter a part of a step."""
        before, slipped_j, spent_j = self._before, self._slipped_j, self._spent_j
        if self.simulation.share < 1.0:
            self._enter_part_taken_back(before, dt_s)
            return
        self._rod = catheter_energy(self.simulation.world, self._work)
        self._enter_tools(before, dt_s)
        self._enter_rod(before, dt_s)
        self._enter_duct(before, dt_s)
        self._enter_contacts(before)
        self.flow.friction_j += _slipped_j(self.simulation) - slipped_j
        self.flow.numerical_j += self.simulation.squeeze.arrays.dissipated_j - self._squeezed_j
        self.flow.effects_j += _dissipated_by_effects_j(self.simulation) - spent_j
        self.flow.effects_j += self._relaxed_by_loads_j()
        self._begun = None
        self.flow.stored_j = self._stored_j() - self._opening_j

    def _relaxed_by_loads_j(self) -> float:
        """What a wall that relaxes has lost in a part of a step by the loads on what its modes leave out."""
        duct, time_s = self.simulation.duct, _relaxed_s(self.simulation) - self._relaxed_s
        loads = duct.viscous_loads
        return 0.0 if loads is None or time_s == 0.0 else loads.lost_j(duct.reduced.residual.store, time_s)

    def _enter_part_taken_back(self, before: _Snapshot, dt_s: float) -> None:
        """Enter what hands have done in a part that has kept only a share of its motion; the rest is withheld."""
        owed_j = self.flow.imbalance_j
        self._rod = catheter_energy(self.simulation.world, self._work)
        if dt_s > 0.0:
            self._enter_tools(before, dt_s)
        self._begun = before if dt_s == 0.0 else None  # of nothing, rows come back, and their motion does not
        self.flow.stored_j = self._stored_j() - self._opening_j
        self.flow.withheld_j += self.flow.imbalance_j - owed_j

    def _stored_j(self) -> float:
        return float(sum(stored_energies_j(self.simulation, self._rod, self._begun).values()))

    def _enter_tools(self, before: _Snapshot, dt_s: float) -> None:
        tools = self.simulation.tools
        stays = (before.present & tools.present)[:, None]
        came = (tools.present & ~before.present)[:, None]
        hand_motion = np.where(stays, tools.hand - before.hand, 0.0)
        change = tools.stretch - np.where(came, 0.0, before.stretch)
        force = tools.stiffness * tools.stretch + tools.damping * change / dt_s
        self.flow.input_j += _given_to_effects_j(self.simulation) - before.given_j
        self.flow.input_j -= float(np.sum(force * hand_motion))
        # Roll turns jaws from e1 to e2 of `tool_frame`, whose cross product is -d.
        about_shaft_nm = np.einsum("ta,ta->t", _port_moments_nm(self.simulation), tools.frame[:, 2])
        self.flow.input_j += float(about_shaft_nm @ tools.rolled_rad)
        self.flow.released_j += 0.5 * float(np.sum(tools.stiffness * np.where(came, before.stretch, 0.0) ** 2))
        self.flow.coupling_j += float(np.sum(tools.damping * change**2)) / dt_s
        self.flow.numerical_j += 0.5 * float(np.sum(tools.stiffness * change**2))

    def _enter_rod(self, before: _Snapshot, dt_s: float) -> None:
        """What the rod's own forces, those that its momentum balance tells, took beyond what is stored and damped."""
        catheter, model = self.simulation.catheter, self._model
        state, start = catheter.state, before.rod
        motion = state.position_m - start.position_m
        change, mean = state.velocity_m_s - start.velocity_m_s, motion / dt_s
        middle = RodState(start.position_m + 0.5 * motion, mean)
        viscous = internal_forces(model, middle, self._work)
        viscous -= internal_forces(model, RodState(middle.position_m, np.zeros_like(mean)), self._work)
        viscous -= model.drag[:, None] * mean
        impulse = model.mass[:, None] * change
        own = impulse / dt_s - catheter.external_force_n - catheter.contact_force_n
        self.flow.rod_j -= float(np.sum(viscous * motion))
        self.flow.numerical_j += float(np.sum(impulse * (mean - start.velocity_m_s - 0.5 * change)))
        self.flow.numerical_j -= float(np.sum((own - viscous) * motion))
        driven_j, apart_j = np.subtract(_driven_j(self.simulation), before.driven_j)
        self.flow.input_j += driven_j + apart_j
        wire, then = self.simulation.wire_drive, before.wire
        if wire is not None and then is not None:
            driven_j += wire.motion.work_j - then.work_j
            self.flow.input_j += wire.motion.input_j - then.input_j
            self.flow.friction_j += wire.motion.friction_j - then.friction_j
            self.flow.numerical_j += wire.motion.numerical_j - then.numerical_j
        self.flow.numerical_j -= self._rod.elastic_j - before.rod_elastic_j - driven_j

    def _enter_duct(self, before: _Snapshot, dt_s: float) -> None:
        duct = self.simulation.duct
        basis, kick = duct.reduced.basis, dt_s * duct.contact_impulse
        jumped, rate = before.modal.qdot + duct.removed_half_impulse + kick, duct.rate()
        end, end_rate = duct.state.qdot - duct.taken, rate - duct.taken
        mean_rate = 0.5 * (jumped + end)
        damping = 2.0 * basis.omega_rad_s * duct.reduced.damping_ratio
        self.flow.duct_j += dt_s * float(np.sum(damping * mean_rate**2))
        change = duct.state.q - before.modal.q
        # The impulse acts at the start of the step; the rows below count its force over the whole of it.
        kicked = jumped**2 - before.duct_rate**2 + end_rate**2 - end**2
        self.flow.impact_j += float(duct.contact_impulse @ change - 0.5 * np.sum(kicked))
        self.flow.numerical_j += 0.5 * float(np.sum(end_rate**2 - rate**2))
        self._enter_residual(before)

    def _enter_residual(self, before: _Snapshot) -> None:
        duct = self.simulation.duct
        change = _loads_on_wall(self.simulation) - before.loads
        nodes = np.flatnonzero(np.any(change != 0.0, axis=1)).astype(np.int32)
        loads, moved = duct.turn_to_world(nodes, change[nodes]), np.zeros((len(nodes), 3))
        duct.reduced.residual.apply(nodes, loads, nodes, moved)
        self.flow.numerical_j += 0.5 * float(np.sum(moved * loads))

    def _enter_contacts(self, before: _Snapshot) -> None:
        """Work of the contact forces on the relative motion, friction and normal apart; anchors store some of it."""
        system = self.simulation.system
        taken_j, gone_j = enter_grips(self.simulation, before.grips)
        self.flow.numerical_j += taken_j
        self.flow.released_j += gone_j
        rows, own = (
            system.rows,
            {*self.simulation.holds.rows, *self.simulation.seal.rows, *self.simulation.squeeze.rows},
        )
        self.flow.friction_j -= _anchor_energy_j(self.simulation) - before.anchors_j
        for row in set(range(rows.n_contacts)) - own:
            force, elastic = rows.force_n[row], rows.frame[row] @ rows.elastic_m[row]
            end = system.motion_m[3 * row : 3 * row + 3] - rows.softness_m_n[row] * force
            self.flow.friction_j -= float(force[1:] @ (end - elastic)[1:])
            if rows.law[row] != _PULL:  # its work is what its effect no longer stores
                self.flow.impact_j -= float(force[0] * (end[0] - rows.effective_gap_m[row]))


@dataclass(slots=True)
class _Snapshot:
    """What the books need of the state before a step."""

    present: BoolArray
    hand: FloatArray
    stretch: FloatArray
    rod: RodState
    rod_elastic_j: float
    modal: ModalState
    duct_rate: FloatArray
    loads: FloatArray
    anchors_j: float
    driven_j: tuple[float, float]
    given_j: float
    wire: WireMotion | None
    grips: Grips

    @classmethod
    def of(cls, simulation: Simulation, rod_energy: RodEnergy, begun: _Snapshot | None) -> _Snapshot:
        """Return what a part begins with; one that is begun again has the rows of a try, and not those of `begun`."""
        rod, tools = simulation.catheter.state, simulation.tools
        return cls(
            tools.present.copy(),
            tools.hand.copy(),
            tools.stretch.copy(),
            rod.copy(),
            rod_energy.elastic_j,
            simulation.duct.state.copy(),
            simulation.duct.rate(),
            _loads_on_wall(simulation),
            _anchor_energy_j(simulation) if begun is None else begun.anchors_j,
            _driven_j(simulation),
            _given_to_effects_j(simulation),
            None if simulation.wire_drive is None else simulation.wire_drive.motion,
            stored_in_grips(simulation) if begun is None else begun.grips,
        )


def _port_moments_nm(simulation: Simulation) -> FloatArray:
    """Return the moment (2, 3) about its port of the contacts' forces on each tool: what is reported is a tick's."""
    rows, n, moments = simulation.contacts, simulation.contacts.n_contacts, np.zeros((N_TOOLS, 3))
    tool = rows.tool[:n]
    on = tool != NO_TOOL
    arm_m = rows.point_m[:n][on] - simulation.tools.port_m[tool[on]]
    np.add.at(moments, tool[on], np.cross(arm_m, simulation.contact_force_n[on]))
    return moments


def stored_energies_j(
    simulation: Simulation, rod: RodEnergy | None = None, begun: _Snapshot | None = None
) -> dict[str, float]:
    """Return what is stored where at the end of the last step: catheter, duct, couplings, grips, and each effect.

    ``rod`` is the catheter's, where it is known already, and ``begun`` what a part began with that was taken back.
    """
    tools, duct = simulation.tools, simulation.duct
    stored = {
        "catheter": (rod or catheter_energy(simulation.world)).total_j,
        "duct": duct.kinetic_energy_j() + duct.strain_energy_j(),
        "duct_load": -float(np.sum(duct.constant_modal_force * duct.state.q)),
        "couplings": 0.5 * float(np.sum(tools.stiffness * tools.stretch**2)),
        "grips": (stored_in_grips(simulation) if begun is None else begun.grips).total_j,
        "squeeze": simulation.squeeze.stored_j,
        "anchors": _anchor_energy_j(simulation) if begun is None else begun.anchors_j,
        "wire": 0.0 if simulation.wire_drive is None else simulation.wire_drive.stored_j,
    }
    stored |= {name: effect.potential_energy_j(simulation.world) for name, effect in simulation.effects.items()}
    return stored


def _given_to_effects_j(simulation: Simulation) -> float:
    return sum(effect.given_j for effect in simulation.effects.values())


def _dissipated_by_effects_j(simulation: Simulation) -> float:
    return sum(effect.dissipated_j for effect in simulation.effects.values())


def _relaxed_s(simulation: Simulation) -> float:
    loads = simulation.duct.viscous_loads
    return 0.0 if loads is None else loads.relaxed_s


def _driven_j(simulation: Simulation) -> tuple[float, float]:
    """What a drive has put in by twisting and steering: into the rod, and into what it and a wire hold apart."""
    return (simulation.drive.work_j, simulation.drive.apart_j) if simulation.drive is not None else (0.0, 0.0)


def _anchor_energy_j(simulation: Simulation) -> float:
    """What the tangents of contacts that stick, or slide, have stored."""
    rows, k = simulation.system.rows, simulation.system.rows.n_contacts
    is_elastic = (np.arange(3) > 0) & HAS_FRICTION[rows.law[:k], None]
    return 0.5 * float(np.sum((rows.softness_m_n[:k] * rows.force_n[:k] ** 2)[is_elastic]))


def _slipped_j(simulation: Simulation) -> float:
    """What slipping holds, and a slipping seal, have taken out."""
    return simulation.holds.dissipated_j + simulation.seal.memory.dissipated_j


def implicit_integrator(simulation: Simulation) -> ImplicitIntegrator:
    """Return the catheter's integrator, which has to be the implicit one."""
    integrator = simulation.catheter.integrator
    if not isinstance(integrator, ImplicitIntegrator):
        raise TypeError("the books are kept for the implicit integrator of the catheter only")
    return integrator


def nodal_loads(simulation: Simulation) -> FloatArray:
    """Return the contact loads (n, 3) on every node of the duct."""
    loads = np.zeros((simulation.duct.reduced.mesh.n_vertices, 3))
    n = simulation.duct.n_loads
    loads[simulation.duct.load_nodes[:n]] = simulation.duct.load_force_n[:n]
    return loads


def _loads_on_wall(simulation: Simulation) -> FloatArray:
    """Return the same loads (n, 3) along the axes of the wall at rest, which its sections turn."""
    duct, loads = simulation.duct, nodal_loads(simulation)
    loaded = np.flatnonzero(np.any(loads != 0.0, axis=1)).astype(np.int32)
    loads[loaded] = duct.turn_to_wall(loaded, loads[loaded])
    return loads


def catheter_energy(world: World, work: RodWork | None = None) -> RodEnergy:
    """Return the catheter's energies with the material frame brought to where the particles are: in a step it lags."""
    integrator, state = world.catheter.integrator, world.catheter.state
    if integrator.twist is not None:
        state = state.copy()
        add_frame_forces(integrator.twist, state, np.zeros_like(state.position_m))
    return rod_energy(integrator.model, state, integrator.twist, work)
