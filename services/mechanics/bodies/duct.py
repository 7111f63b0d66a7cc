"""The duct in a step: modal prediction, displacement at contacts, and the effect of contact impulses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray, IntArray, LongArray
from trocar.services.mechanics.bodies.duct_loads import DuctLoads, DuctMotion, correct, hold_force, motion_at
from trocar.services.mechanics.bodies.wall_motion import wall_motion
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.reduction.modal_state import ModalIntegrator, ModalState
from trocar.services.mechanics.reduction.newmark import Newmark, newmark_step
from trocar.services.mechanics.reduction.node_compliance import Loads
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.viscoelastic import ViscousModes
from trocar.services.mechanics.reduction.viscous_loads import ViscousLoads

_NO_LOADS: Loads = (np.zeros(0, np.int32), np.zeros((0, 3)))


class DuctBody:
    r"""Modal state of the duct and its contact loads.

    A contact force f is applied as the impulse :math:`f \Delta t` at the *start* of the step, and contact conditions
    hold for the position at its end. Applied over the step instead, any integrator with
    :math:`x^+ - x = (v + v^+) \Delta t / 2` turns the velocity of a touching point round in every tick
    (contact chatter). As an impulse the static response is the same, an impact is inelastic, and a
    lasting contact does no work on the duct in equilibrium.

    Attributes:
        modes: (3 C, r) float64. Rows of the modes at the contact points, world axes, d position / d q at the start of
            the step; valid for the contacts of this step, as the next two.
        displacement_m, motion_m: (C, 3) float64. Displacement of the contact points at the start of the step, and their
            motion over it without contact forces.
        load_nodes: (L,) int32, load_force_n: (L, 3) float64, n_loads: int. Contact forces on nodes, each node once;
            they act through the residual compliance.
        motion_address: Address[DuctMotion], loads_address: Address[DuctLoads]. The modes and their loads, and the
            contact loads, for kernels.
        kept_address: Address[NodeArrays] or None. The compliance cached between nodes, if there is a cache.
        sections: tuple of Address[WarpedTube]. Where the sections of a wall with large rotations are at the start of a
            step, and at its end once contact forces are there; zeros for one without.
        modal_force: (r,) float64. Loads of effects on the modes in this step, the constant ones included.
        constant_modal_force: (r,) float64
        held_force: (r,) float64. Part of ``modal_force`` that is the same over all of the step, from its start on; see
            `hold`.
        free_end_parts: (4, r) float64. The coordinates at the end of a step are these times coordinates, rates and
            accelerations at its start, and times the force in it, in sum.
        removed_half_impulse: (r,) float64. Rates that `remove_half_impulse` has subtracted at the start of this step.
        terms: the wall's terms beyond the linear modes, see `wall_terms`; None where nobody has brought any.
        viscous, viscous_loads: ViscousModes, ViscousLoads or None. What lags of the modes and of the loads, if the wall
            relaxes.
        taken: (r,) float64. Change of the rates at the end of the last step, see `pay_for_impulses`.
    """

    def __init__(self, reduced: ReducedDuct, integrator: ModalIntegrator, capacity: int) -> None:
        self._motion = wall_motion(reduced, capacity)
        self.reduced = self._motion.reduced
        self.integrator = integrator
        n_modes = reduced.basis.n_modes
        self.state = ModalState.at_rest(n_modes)
        free = DuctMotion.zeros(r=n_modes, q=self.state.q, qdot=self.state.qdot, qddot=self.state.qddot)
        self.q_start, self.dq_free = free.start, free.change
        self.modal_force, self.constant_modal_force = free.force, free.constant
        self.removed_half_impulse, self.taken = free.removed_half_impulse, free.taken
        self.held_force, self._held_gains = free.held, np.zeros((3, n_modes))
        self.free_end_parts = np.zeros((4, n_modes))
        self._free, self.motion_address = free, free.address
        loads = DuctLoads.zeros(
            r=n_modes,
            c=capacity,
            l=3 * capacity,
            free=free,
            damping=2.0 * reduced.basis.omega_rad_s * reduced.damping_ratio,
            modes=np.zeros((3 * capacity, n_modes)),
            slot=np.full(reduced.mesh.n_vertices, -1, np.int32),
        )
        self.modes, self.displacement_m, self.motion_m = loads.modes, loads.displacement, loads.motion
        self.load_nodes, self.load_force_n, self._n_loads = loads.node, loads.force, loads.count
        self.contact_impulse, self._debt, self._gains = loads.impulse, loads.debt, loads.gains
        self._gains_dt_s = 0.0
        self._ignored_motion = np.zeros((capacity, 3))
        self.lasting_loads = _NO_LOADS
        self._loads, self.loads_address = loads, loads.address
        self.terms: Any = None
        self.viscous: ViscousModes | None = None
        self.viscous_loads: ViscousLoads | None = None
        self.kept_address, self.sections = self._motion.kept_address, self._motion.sections

    def set_constant_load(self, nodal_n: FloatArray) -> None:
        """Set a constant load (n, 3) and start in equilibrium with it."""
        basis = self.reduced.basis
        self.constant_modal_force[:] = np.einsum("nar,na->r", basis.Phi, nodal_n)
        self.state.q[:] = self.constant_modal_force / basis.omega_rad_s**2

    def predict(self, dt_s: float) -> None:
        """Step the modes without contact forces."""
        if dt_s != self._gains_dt_s:
            self.change_step(dt_s)
        self._n_loads[1] = 0
        self.lasting_loads = _NO_LOADS
        self._motion.update(self.state.q)
        integrator = self.integrator
        if type(integrator) is Newmark:
            predict_by_newmark(self._free.address, integrator.constants(dt_s), dt_s)
            return
        self.q_start[:] = self.state.q
        self.removed_half_impulse[:] = self.taken[:] = 0.0
        self._free.before[:] = self.state.qdot
        integrator.predict(self.state, self.modal_force, dt_s)
        np.subtract(self.state.q, self.q_start, out=self.dq_free)

    def gather(self, nodes: IntArray, weights: FloatArray) -> None:
        """Collect the modes at the contact points, their displacement and their free motion over the step.

        ``nodes`` and ``weights`` (k, 3) are the barycentric points; all weights are zero where a contact is elsewhere.
        The free motion releases the residual displacement under last tick's loads, which contacts replace.
        """
        n, count = len(nodes), self.n_loads
        loads = self.load_nodes[:count], self.load_force_n[:count]
        out = self.modes[: 3 * n], self.displacement_m[:n], self.motion_m[:n]
        self._motion.gather((nodes, weights), (self.q_start, self.dq_free), loads, out)

    def displace(self, nodes: IntArray, weights: FloatArray) -> None:
        """Add the residual displacements that `gather_kept` left out where it returned False."""
        n, count = len(nodes), self.n_loads
        loads = self.load_nodes[:count], self.load_force_n[:count]
        self._motion.add_residual((nodes, weights), loads, (self.displacement_m[:n], self.motion_m[:n]))

    def add_load_displacement(
        self, nodes: IntArray, weights: FloatArray, loads: tuple[IntArray, FloatArray], out: FloatArray
    ) -> None:
        """Add to ``out`` (k, 3) the displacements beyond the modes by ``loads``: nodes (l,) and forces (l, 3) in N.

        Points are those of the last `gather`, which released all loads; these loads keep acting through the step.
        """
        self.lasting_loads = loads
        self._motion.add_residual((nodes, weights), loads, (out, self._ignored_motion[: len(nodes)]))

    def turn_to_wall(self, nodes: IntArray, forces: FloatArray) -> FloatArray:
        """Return contact forces (k, 3) at the end of a step, on nodes (k,), along the axes of the wall at rest: a copy.

        What a wall does by itself is told along these, which its sections turn: laws of its shape, and what lags in it.
        """
        own = forces.copy()
        self._motion.update(self.state.q)
        self._motion.turn_to_wall(nodes, own)
        return own

    def turn_to_world(self, nodes: IntArray, forces: FloatArray) -> FloatArray:
        """Return forces (k, 3) along world axes, of those along the axes of the wall: a copy."""
        there = forces.copy()
        self._motion.turn_to_world(nodes, there)
        return there

    def replace_loads(self, count: int) -> None:
        """Set the number of loads after a caller has rewritten ``load_nodes`` and ``load_force_n``."""
        self._n_loads[0] = count

    def compliance(
        self, nodes: IntArray, weights: FloatArray, out: FloatArray, first: int = 0, *, anew: bool = False
    ) -> int:
        """Write the compliance between the points of the last `gather` into the lower blocks of ``out`` (3 k, 3 k).

        In m/N at the end of the step, along world axes. It includes all modes, because forces act on all of them: with
        fewer the wall would yield more than the solve knows, and every tick would add energy. ``anew`` bypasses the
        cache between nodes. What couples the points before ``first`` is there already. Return the first point whose
        blocks were written: that one, or 0.
        """
        points, rows, gain = (nodes, weights), self.modes[: 3 * len(nodes)], self.position_gain
        if anew:
            self._motion.compliance_uncached(points, rows, gain, out)
            return 0
        return self._motion.compliance(points, rows, gain, out, first)

    def correct(self, nodes: IntArray, weights: FloatArray, forces: FloatArray) -> None:
        """Apply the contact forces (k, 3) on the first bodies, reversed, to modes and loads; points as in `gather`."""
        correct(self._loads.address, nodes, weights, forces, self.dt_s)
        self.turn_loads()

    def turn_loads(self) -> None:
        """Turn the contact loads along with the sections of a wall with large rotations, to the end of the step.

        What they have displaced beyond the modes rides along, as the rows of `gather` say: it stays as it is along the
        axes of the wall, and so does the energy that it stores.
        """
        n = self.n_contact_loads
        self._motion.turn_along(self.load_nodes[:n], self.load_force_n[:n], self.state.q)

    def modal_load(self, forces: FloatArray) -> FloatArray:
        """Return the modal load (r,) of contact forces (k, 3), in the order of the last rows."""
        load: FloatArray = -self.modes[: forces.size].T @ forces.ravel()
        return load

    def remove_half_impulse(self, load: FloatArray) -> None:
        """Subtract from the rates the half impulse left by contacts with the modal load ``load`` (r,).

        The impulse of the next step would have balanced it. Where a contact vanishes (a tool is withdrawn), it would
        remain as motion without a cause. Call this between `predict` and `gather`.
        """
        ended = 0.5 * load
        for end, gain in zip((self.state.q, self.state.qdot, self.state.qddot), self._gains, strict=True):
            end += gain * ended
        self.dq_free += self._gains[0] * ended
        self.removed_half_impulse += self.dt_s * ended

    def hold(self, last: FloatArray, force: FloatArray) -> None:
        """Hold a modal force (r,) over the step in place of ``last`` (r,), which is overwritten by it.

        The step begins with it: Newmark's takes the mean of both ends, and a force that was given to its end alone
        would lag by half a step. ``last`` is zero at first, and part of the state of whoever holds the force.
        """
        hold_force(self.motion_address, last, force)

    def furthest_m(self, change: FloatArray) -> float:
        """Return how far (m) a change (r,) of the coordinates moves a node, by the modes; too slow for every tick."""
        return float(np.linalg.norm(self.reduced.basis.displacements(change), axis=1).max())

    def change_held(self, held: FloatArray, change: FloatArray) -> None:
        """Change the end of the step as if a force that it ``held`` (r,) had been larger by ``change`` (r,)."""
        for end, gain in zip((self.state.q, self.state.qdot, self.state.qddot), self._held_gains, strict=True):
            end += gain * change
        for force in (held, self.held_force, self.modal_force):
            force += change

    def remove_energy(self, energy_j: float) -> float:
        """Remove up to ``energy_j`` of kinetic energy from the rates of the step's end; return the amount, in J."""
        rate = self.rate()
        kinetic_j = 0.5 * float(rate @ rate)
        paid = min(energy_j / kinetic_j, 1.0) if kinetic_j > 0.0 else 0.0
        change = (math.sqrt(1.0 - paid) - 1.0) * rate
        self.state.qdot += change
        self.state.qddot -= self._loads.damping * change
        self.taken += change
        return paid * kinetic_j

    def point_at_start(self, triangle: int, weights: FloatArray) -> FloatArray:
        """Return the position (3,) in m of a point of a triangle at the start of the step; too slow for every tick."""
        nodes = self.reduced.mesh.triangles[triangle]
        corners = self._motion.position_function(nodes)(self.q_start)
        n = self.n_loads
        self.reduced.residual.apply(self.load_nodes[:n], self.load_force_n[:n], nodes, corners)
        point: FloatArray = weights @ corners
        return point

    def surface_m(self) -> FloatArray:
        """Return the positions (n, 3) in m of all nodes at the end of the last step; too slow for every tick."""
        self._motion.update(self.state.q)
        nodes = np.arange(self.reduced.mesh.n_vertices, dtype=np.int32)
        positions = self._motion.position_function(nodes)(self.state.q)
        n = self.n_loads
        if n:
            self.reduced.residual.apply(self.load_nodes[:n], self.load_force_n[:n], nodes, positions)
        return positions

    @property
    def held_gain(self) -> FloatArray:
        """(r,) change of q at the end of the step per modal force that is held over it."""
        gain: FloatArray = self._held_gains[0]
        return gain

    @property
    def position_gain(self) -> FloatArray:
        """(r,) change of q at the end of the step per modal contact force."""
        gain: FloatArray = self._gains[0]
        return gain

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        state, forces = self.state, (self.contact_impulse, self.held_force)
        return state.q, state.qdot, state.qddot, *forces, self.load_nodes, self.load_force_n, self._n_loads

    def corrected_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that `correct` changes."""
        state, loads = self.state, self._loads
        modal = state.q, state.qdot, state.qddot, self.contact_impulse, loads.last, self._debt, self.taken
        return *modal, self.load_nodes, self.load_force_n, self._n_loads

    def load_arrays(self) -> tuple[IntArray, FloatArray, LongArray]:
        """Return the live arrays of the loads on nodes: nodes, forces, and how many there are."""
        return self.load_nodes, self.load_force_n, self._n_loads

    def write_acceleration(self) -> None:
        """Write the acceleration that belongs to position, rates and loads."""
        self.state.qddot[:] = self.modal_force - self.reduced.basis.omega_rad_s**2 * self.state.q
        self.state.qddot -= self._loads.damping * self.state.qdot

    def step_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that a step changes, from `predict` on."""
        return *self.corrected_arrays(), self.held_force

    def halt(self) -> None:
        """Stop all motion at the present position."""
        self._debt[:] = 0.0
        self.state.qdot[:] = -self._half_impulse()
        self.state.qddot[:] = self.constant_modal_force + self.held_force
        self.state.qddot -= self.reduced.basis.omega_rad_s**2 * self.state.q
        self.state.qddot -= self._loads.damping * self.state.qdot

    @property
    def owed_j(self) -> float:
        """Energy that contacts added beyond their work and that could not be removed yet; see `pay_for_impulses`."""
        return float(self._debt[0])

    @property
    def n_loads(self) -> int:
        """Number of loaded nodes."""
        return int(self._n_loads.item(0))

    @property
    def n_contact_loads(self) -> int:
        """Number of loads, the first ones, that are contact forces of this step; effects may have added others."""
        return int(self._n_loads[1])

    def rate(self) -> FloatArray:
        """Return the rates (r,) of the modes halfway between the impulses of two steps.

        Those at the end of a step lack half of the impulse of a lasting contact, which the next step begins
        with: in a pressed wall at rest they oscillate by f dt / 2.
        """
        rate: FloatArray = self.state.qdot + self._half_impulse()
        return rate

    def _half_impulse(self) -> FloatArray:
        half: FloatArray = 0.5 * self.dt_s * self.contact_impulse
        return half

    def kinetic_energy_j(self) -> float:
        """Kinetic energy of the modes at their `rate`."""
        rate = self.rate()
        return 0.5 * float(rate @ rate)

    def strain_energy_j(self) -> float:
        """Elastic energy of the modes and of the residual compliance under the contact loads; for studies."""
        self._motion.update(self.state.q)
        modal = self.state.strain_energy_j(self.reduced.basis.omega_rad_s)
        n = self.n_loads
        nodes, force, moved = self.load_nodes[:n], self.load_force_n[:n], np.zeros((n, 3))
        self.reduced.residual.apply(nodes, force, nodes, moved)
        return modal + 0.5 * float(np.sum(moved * force))

    def change_step(self, dt_s: float) -> None:
        """Prepare for a step of this length, if it is another than the last one's.

        With a lasting force f of contacts the rates swing from -f dt / 2 at the end of a step to +f dt / 2
        after the impulse at the start of the next one. The part that belongs to the old length would remain as motion
        without a cause, so it is taken out.
        """
        if dt_s == self.dt_s:
            return
        if self.dt_s > 0.0:
            change = (1.0 - dt_s / self.dt_s) * self._half_impulse()
            self.state.qdot += change
            self.state.qddot -= 2.0 * self.reduced.basis.omega_rad_s * self.reduced.damping_ratio * change
        self._prepare(dt_s)

    @property
    def dt_s(self) -> float:
        """Length of the last step, 0 before the first."""
        return self._gains_dt_s

    def _prepare(self, dt_s: float) -> None:
        """Find the gains by letting the integrator carry a unit jump of the rates, and a unit force, through a step.

        The jump also changes the acceleration, by the damping force.
        """
        n_modes = self.state.q.size
        damping = 2.0 * self.reduced.basis.omega_rad_s * self.reduced.damping_ratio
        probe = ModalState(np.zeros(n_modes), np.ones(n_modes), -damping)
        self.integrator.predict(probe, np.zeros(n_modes), dt_s)
        self._gains[:] = dt_s * np.stack([probe.q, probe.qdot, probe.qddot])
        held = ModalState(np.zeros(n_modes), np.zeros(n_modes), np.ones(n_modes))
        self.integrator.predict(held, np.ones(n_modes), dt_s)
        self._held_gains[:] = held.q, held.qdot, held.qddot
        for part, unit in enumerate(np.eye(4)):
            begun = ModalState(*(np.full(n_modes, each) for each in unit[:3]))
            self.integrator.predict(begun, np.full(n_modes, unit[3]), dt_s)
            self.free_end_parts[part] = begun.q
        self._gains_dt_s = dt_s


@kernel
def predict_by_newmark(address: Address[DuctMotion], constants: FloatArray, dt_s: float) -> None:
    """Note the start, step the modes with the ``constants`` of `Newmark`, and note the change."""
    modes = motion_at(address)
    for mode in range(modes.q.shape[0]):
        modes.start[mode], modes.before[mode], modes.removed_half_impulse[mode] = modes.q[mode], modes.qdot[mode], 0.0
        modes.taken[mode] = 0.0
    newmark_step(modes.q, modes.qdot, modes.qddot, modes.force, constants, dt_s)
    for mode in range(modes.q.shape[0]):
        modes.change[mode] = modes.q[mode] - modes.start[mode]
