"""What is read off a simulation after every step, and the figures that come of it."""

from __future__ import annotations

import hashlib
import math

import numpy as np

from services.mechanics.arrays import BoolArray, FloatArray
from services.mechanics.collision.pairs import NO_TOOL
from services.mechanics.contact.laws import HAS_GAP
from services.mechanics.rod.model import RodModel
from services.mechanics.scene.tools import N_TOOLS
from services.mechanics.simulation import Simulation
from studies.energy_book import EnergyFlow, implicit_integrator
from studies.stability.criteria import REST_SPEED_M_S, Figures
from studies.stability.crossings import count_crossings

G_M_S2 = 9.81
CROSSINGS_EVERY = 50
WALL_NODES = 32
LEAST_ENERGY_J = 1e-6
"""A catheter of this length at 0.1 m/s; less is noise of what the books are taken from."""
FASTEST_SWEEP_M_S = 2.0
"""No hand is faster; a tool's target that jumps is swept at no more."""


class Watch:
    """Keeps the worst of everything that the criteria ask for."""

    def __init__(self, simulation: Simulation, hand_speed_m_s: float) -> None:
        self._simulation = simulation
        self._rod = _Rod(simulation)
        self._hand_m_s = min(hand_speed_m_s, FASTEST_SWEEP_M_S)
        self._energy = _Energy()
        basis = simulation.duct.reduced.basis
        nodes = np.linspace(0, len(basis.Phi) - 1, WALL_NODES).astype(np.int64)
        self._wall = np.ascontiguousarray(basis.Phi[nodes].reshape(3 * WALL_NODES, -1))
        duct = simulation.scene.duct
        self._wall_sound_m_s = math.sqrt(duct.youngs_modulus_pa / duct.density_kg_m3)
        self._healed_states = simulation.healed_states
        self._contact_n = self._contact_forces_n()
        self._force_n = simulation.tool_results.force_n.copy()
        self._present = simulation.tools.present.copy()
        self._largest_force_n = 0.0
        self._strain = 0.0
        self._steps = 0
        self.worst: Figures = dict.fromkeys(
            (
                *("raised", "not_finite", "speed", "stretch", "penetration", "tool_penetration", "crossings"),
                *("force_step", "felt_step"),
            ),
            0.0,
        )

    def look(self, dt_s: float, flow: EnergyFlow | None) -> bool:
        """Enter the step that was just taken; False where nothing is finite any more."""
        self._steps += 1
        if not self._is_finite():
            self.worst["not_finite"] += 1
            return False
        self._look_at_forces(dt_s)
        self._look_at_rod()
        self._look_at_overlaps()
        if self._steps % CROSSINGS_EVERY == 0:
            self.count_crossings()
        if flow is not None:
            self._energy.enter(flow)
        return True

    def speed_m_s(self) -> float:
        """Fastest particle or wall node."""
        return max(self._rod.speed_m_s(), self._wall_speed_m_s())

    def count_crossings(self) -> None:
        """Count where the catheter crosses the wall now."""
        duct = self._simulation.duct
        line = self._simulation.catheter.state.position_m
        self._keep("crossings", count_crossings(line, duct.surface_m(), duct.reduced.mesh.triangles))

    def energy_figures(self) -> Figures:
        """What the books say."""
        return self._energy.figures()

    def digest(self) -> str:
        """A name for the state and all figures, to the last bit."""
        rod, duct = self._simulation.catheter.state, self._simulation.duct.state
        parts = (rod.position_m, rod.velocity_m_s, duct.q, duct.qdot, np.array(list(self.worst.values())))
        return hashlib.blake2b(b"".join(part.tobytes() for part in parts), digest_size=8).hexdigest()

    def _keep(self, name: str, value: float) -> None:
        self.worst[name] = max(self.worst[name], value)

    def _is_finite(self) -> bool:
        rod, duct, felt = self._simulation.catheter.state, self._simulation.duct.state, self._simulation.tool_results
        total = rod.position_m.sum() + rod.velocity_m_s.sum() + duct.q.sum() + duct.qdot.sum() + felt.force_n.sum()
        return math.isfinite(total)

    def _look_at_forces(self, dt_s: float) -> None:
        felt, tools, contact_n = self._simulation.tool_results, self._simulation.tools, self._contact_forces_n()
        for tool in np.flatnonzero(self._present & tools.present):
            for name, now_n, before_n in (
                ("force_step", contact_n, self._contact_n),
                ("felt_step", felt.force_n, self._force_n),
            ):
                change_n = now_n[tool] - before_n[tool]
                self._keep(name, math.sqrt(float(change_n @ change_n)) / max(dt_s / 1e-3, 1.0))
        self._force_n[:], self._present[:], self._contact_n = felt.force_n, tools.present, contact_n
        self._largest_force_n = max(self._largest_force_n, math.sqrt(float((felt.force_n**2).sum(axis=1).max())))

    def _contact_forces_n(self) -> FloatArray:
        """Return the contact force on each tool (2, 3), before the limiter; none in a tick that ended in a heal."""
        simulation, forces = self._simulation, np.zeros((N_TOOLS, 3))
        is_healed, self._healed_states = (
            simulation.healed_states > self._healed_states,
            simulation.healed_states,
        )
        rows, n = simulation.contacts, simulation.contacts.n_contacts
        if n and not is_healed:
            by_tool = rows.tool[:n] != NO_TOOL
            each = np.einsum("kac,ka->kc", rows.lever[:n, :, :3], simulation.contact_force_n)
            np.add.at(forces, rows.tool[:n][by_tool], each[by_tool])
        return forces

    def _look_at_rod(self) -> None:
        rod = self._rod
        fall_m_s = math.sqrt(2.0 * G_M_S2 * rod.length_m)
        speed = rod.speed_m_s()
        allowed = 2.0 * self._hand_m_s + fall_m_s + rod.sound_m_s * self._strain
        wall = 2.0 * self._hand_m_s + fall_m_s + self._wall_sound_m_s
        self._keep("speed", max(speed / allowed, self._wall_speed_m_s() / wall))
        stretch, bend = rod.strains()
        self._strain = max(self._strain, stretch, bend)
        explained = self._largest_force_n / rod.stiffness_n + 2.0 * self._hand_m_s / rod.sound_m_s
        self._keep("stretch", stretch - explained)

    def _wall_speed_m_s(self) -> float:
        velocity = (self._wall @ self._simulation.duct.rate()).reshape(-1, 3)
        return math.sqrt(float(np.einsum("ij,ij->i", velocity, velocity).max()))

    def _look_at_overlaps(self) -> None:
        rows = self._simulation.contacts
        n = rows.n_contacts
        if n:
            by_tool = rows.tool[:n] != NO_TOOL
            depth_m = np.where(_HAS_GAP[rows.law[:n]], -rows.gap_m[:n] - self._squeezed_m(by_tool), 0.0)
            self._keep("penetration", float(depth_m[~by_tool].max(initial=0.0)))
            self._keep("tool_penetration", float(depth_m[by_tool].max(initial=0.0)))

    def _squeezed_m(self, by_tool: BoolArray) -> FloatArray:
        """How much nearer jaws are to the middle of the wall where each contact is (k,), because they squeeze it.

        Where a caller let them hold a wall that was in them already, it is in them still.
        """
        rows, tools = self._simulation.contacts, self._simulation.tools
        n = rows.n_contacts
        is_squeezed = by_tool & (rows.pad_m[:n] > tools.pad_m[rows.tool[:n]])
        return np.where(is_squeezed, rows.pad_m[:n], 0.0)


_HAS_GAP = np.array(HAS_GAP, dtype=np.bool_)


class _Rod:
    """Speeds and strains of the catheter."""

    def __init__(self, simulation: Simulation) -> None:
        catheter = simulation.catheter
        model: RodModel = implicit_integrator(simulation).model
        self._state = catheter.state
        self._rest_m = model.rest_length
        self._radius_m = catheter.radius_m
        self.length_m = model.rest_length * len(model.EA)
        self.stiffness_n = float(model.EA.min())
        self.sound_m_s = math.sqrt(float(model.EA.max()) * model.rest_length / float(model.mass[1:-1].min()))

    def speed_m_s(self) -> float:
        velocity: FloatArray = self._state.velocity_m_s
        return math.sqrt(float(np.einsum("ij,ij->i", velocity, velocity).max()))

    def strains(self) -> tuple[float, float]:
        """Largest stretch or compression, and largest strain of bending at the catheter's surface."""
        segments = np.diff(self._state.position_m, axis=0)
        lengths = np.sqrt(np.einsum("ij,ij->i", segments, segments))
        turned = np.diff(segments / lengths[:, None], axis=0)
        bend = math.sqrt(float(np.einsum("ij,ij->i", turned, turned).max())) / self._rest_m * self._radius_m
        return float(np.abs(lengths / self._rest_m - 1.0).max()), bend


class _Energy:
    """The books of a run as ratios of the largest energy in it."""

    def __init__(self) -> None:
        self._largest_j = LEAST_ENERGY_J
        self._highest_j = 0.0
        self._fall_j = 0.0
        self._imbalance_j = 0.0

    def enter(self, flow: EnergyFlow) -> None:
        spent_j = flow.input_j - flow.stored_j
        self._largest_j = max(self._largest_j, abs(flow.input_j), abs(flow.stored_j))
        self._highest_j = max(self._highest_j, spent_j)
        self._fall_j = max(self._fall_j, self._highest_j - spent_j)
        self._imbalance_j = max(self._imbalance_j, abs(flow.imbalance_j))

    def figures(self) -> Figures:
        return {"gain": self._fall_j / self._largest_j, "imbalance": self._imbalance_j / self._largest_j}


def is_at_rest(speed_m_s: float) -> bool:
    """Whether this counts as standing still."""
    return speed_m_s < REST_SPEED_M_S
