"""What is read off a simulation after every step, and the figures that come of it."""

from __future__ import annotations

import hashlib
import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.contact.laws import HAS_GAP
from trocar.services.mechanics.rod.model import RodModel
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.energy_book import EnergyFlow, implicit_integrator
from trocar.studies.judge.overlaps import BODIES, IN_CATHETER, OF_TOOLS, OverlapJudge, pose_tools
from trocar.studies.stability.criteria import CRITERIA, REST_SPEED_M_S, Figures
from trocar.studies.stability.crossings import count_crossings
from trocar.studies.stability.finely import Explained, contact_forces_n, nearest_on

G_M_S2 = 9.81
CROSSINGS_EVERY = 50
JUDGED_EVERY_S = 5e-3
WALL_NODES = 32
LEAST_ENERGY_J = 1e-6
"""A catheter of this length at 0.1 m/s; less is noise of what the books are taken from."""
FASTEST_SWEEP_M_S = 2.0
"""No hand is faster; a tool's target that jumps is swept at no more."""
LEAST_FORCE_N_2 = 1e-24


class Watch:
    """Keeps the worst of everything that the criteria ask for.

    Attributes:
        sudden: list of (int, int). Steps and tools in which a force changed by more than its criterion, as far as
            nothing explains it.
    """

    def __init__(self, simulation: Simulation, hand_speed_m_s: float, explained: Explained | None = None) -> None:
        self._simulation, self._explained = simulation, explained or {}
        self.sudden: list[tuple[int, int]] = []
        self._rod = _Rod(simulation)
        self._hand_m_s = min(hand_speed_m_s, FASTEST_SWEEP_M_S)
        self._energy = _Energy()
        basis = simulation.duct.reduced.basis
        nodes = np.linspace(0, len(basis.Phi) - 1, WALL_NODES).astype(np.int64)
        self._wall = np.ascontiguousarray(basis.Phi[nodes].reshape(3 * WALL_NODES, -1))
        duct = simulation.scene.duct
        self._wall_sound_m_s = math.sqrt(duct.youngs_modulus_pa / duct.density_kg_m3)
        self._judge, self._deep_m = OverlapJudge(simulation), 0.0
        self._segments = np.zeros_like(simulation.tools.segments)
        limits_m = CRITERIA["penetration_hand"].limit, CRITERIA["penetration_any"].limit * duct.thickness_m
        self._half_limit_m = 0.5 * min(limits_m)
        radius_m = simulation.catheter.radius_m
        self._thick_m = {name: radius_m if name in IN_CATHETER else duct.thickness_m for name in BODIES}
        self._healed_states = simulation.healed_states
        self._contact_n = self._contact_forces_n(is_healed=False)
        self._present = simulation.tools.present.copy()
        self._largest_force_n = 0.0
        self._strain = 0.0
        self._steps = 0
        self.worst: Figures = dict.fromkeys(
            (
                *("raised", "not_finite", "speed", "stretch", "penetration", "penetration_any"),
                *("tool_penetration", "tool_penetration_any", "tool_crossings", "crossings"),
                *("force_step", "force_fall", "felt_error"),
            ),
            0.0,
        )

    def look(self, dt_s: float, flow: EnergyFlow | None) -> bool:
        """Enter the step that was just taken; False where nothing is finite any more."""
        self._steps += 1
        if not self._is_finite():
            self.worst["not_finite"] += 1
            return False
        is_healed = self._simulation.healed_states > self._healed_states
        self._healed_states = self._simulation.healed_states
        self._look_at_overlaps(dt_s)
        self._look_at_forces(dt_s, is_healed)
        self._look_at_rod()
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

    def _look_at_forces(self, dt_s: float, is_healed: bool) -> None:
        felt_n, tools = self._simulation.tool_results.force_n, self._simulation.tools
        contact_n, ticks = self._contact_forces_n(is_healed), max(dt_s / 1e-3, 1.0)
        for tool in np.flatnonzero(self._present & tools.present):
            fallen_n = self._fallen_n(int(tool), contact_n[tool]) * (not is_healed)
            step_n = _size(contact_n[tool] + fallen_n - self._contact_n[tool]) / ticks
            if step_n > CRITERIA["force_step"].limit:
                self.sudden.append((self._steps, int(tool)))
            self._keep("force_step", step_n)
            self._keep("force_fall", _size(fallen_n) / ticks)
            self._keep("felt_error", _size(felt_n[tool] - contact_n[tool]))
        self._present[:], self._contact_n = tools.present, contact_n
        self._largest_force_n = max(self._largest_force_n, math.sqrt(float((felt_n**2).sum(axis=1).max())))

    def _contact_forces_n(self, is_healed: bool) -> FloatArray:
        """Return the contact force on each tool (2, 3); none in a tick that ended in a heal."""
        return np.zeros((N_TOOLS, 3)) if is_healed else contact_forces_n(self._simulation)

    def _fallen_n(self, tool: int, contact_n: FloatArray) -> FloatArray:
        """Return by how much a force fell at once; with finer steps known, by what they lead nearest to it."""
        before_n, known_n = self._contact_n[tool], self._explained.get((self._steps, tool))
        if known_n is None:
            return _fall(before_n, contact_n)
        fallen_n: FloatArray = before_n - nearest_on(known_n, contact_n)
        return fallen_n

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

    def _look_at_overlaps(self, dt_s: float) -> None:
        """Ask the judge now and then, and always where something is half as deep as it may be."""
        is_due = self._steps % max(round(JUDGED_EVERY_S / dt_s), 1) == 0
        if is_due or self._deep_m > self._half_limit_m or self._rows_depth_m() > self._half_limit_m:
            self._judge_overlaps()

    def _judge_overlaps(self) -> None:
        depths = self._judge.look()
        self._keep("tool_crossings", self._count_tool_crossings())
        for name, depth_m in depths.items():
            figure = "tool_penetration" if name in OF_TOOLS else "penetration"
            self._keep(figure, depth_m)
            self._keep(f"{figure}_any", depth_m / self._thick_m[name])
        self._deep_m = max(depths.values())

    def _count_tool_crossings(self) -> int:
        """Count the shafts and jaws whose axis goes through the wall now."""
        duct, tools = self._simulation.duct, self._simulation.tools
        pose_tools(tools, self._segments)
        wall_m, triangles = duct.surface_m(), duct.reduced.mesh.triangles
        is_there = (tools.present & ~tools.disengaged)[:, None] & (tools.radius_m > 0.0)
        return sum(count_crossings(axis_m, wall_m, triangles) for axis_m in self._segments[is_there])

    def _rows_depth_m(self) -> float:
        """Return how deep the solver's rows say that something was when the step began, squeezed walls apart."""
        rows, tools = self._simulation.contacts, self._simulation.tools
        n = rows.n_contacts
        squeezed = (rows.tool[:n] != NO_TOOL) & (
            rows.rest_offset_m[:n] > tools.rest_offset_m[rows.tool[:n]].max(axis=1)
        )
        depth_m = -rows.gap_m[:n] - np.where(squeezed, rows.rest_offset_m[:n], 0.0)
        return float(depth_m[_HAS_GAP[rows.law[:n]]].max(initial=0.0))


_HAS_GAP = np.array(HAS_GAP, dtype=np.bool_)


class _Rod:
    """Speeds and strains of the catheter."""

    def __init__(self, simulation: Simulation) -> None:
        catheter = simulation.catheter
        model: RodModel = implicit_integrator(simulation).model
        self._state = catheter.state
        self._rest_m, self._radii_m = model.rest_length, catheter.radii_m[1:-1]  # of a joint: of what follows it
        self.length_m = float(model.rest_length.sum())
        self.stiffness_n = float(model.EA.min())
        self.sound_m_s = math.sqrt(float((model.EA * self._rest_m).max()) / float(model.mass[1:-1].min()))

    def speed_m_s(self) -> float:
        velocity: FloatArray = self._state.velocity_m_s
        return math.sqrt(float(np.einsum("ij,ij->i", velocity, velocity).max()))

    def strains(self) -> tuple[float, float]:
        """Largest stretch or compression, and largest strain of bending at the catheter's surface."""
        segments = np.diff(self._state.position_m, axis=0)
        lengths = np.sqrt(np.einsum("ij,ij->i", segments, segments))
        turned = np.diff(segments / lengths[:, None], axis=0)
        bend = np.sqrt(np.einsum("ij,ij->i", turned, turned)) * self._radii_m / self._rest_m[1:]
        return float(np.abs(lengths / self._rest_m - 1.0).max()), float(bend.max())


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
        figures = {"gain": self._fall_j, "imbalance": self._imbalance_j}
        return {name: value / self._largest_j for name, value in figures.items()}


def _fall(before: FloatArray, now: FloatArray) -> FloatArray:
    """Return by how much a force fell towards zero on its way to another one: what is left of it, it keeps."""
    kept = float(before @ now) / max(float(before @ before), LEAST_FORCE_N_2)
    fallen: FloatArray = before * (1.0 - min(max(kept, 0.0), 1.0))
    return fallen


def _size(vector: FloatArray) -> float:
    return math.sqrt(float(vector @ vector))


def is_at_rest(speed_m_s: float) -> bool:
    """Whether this counts as standing still."""
    return speed_m_s < REST_SPEED_M_S
