"""Gallstones: rigid spheres in the duct that catheter and wall push about."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.collision import CatheterContactDetector
from services.mechanics.collision.pairs import NO_TOOL, ContactPairs
from services.mechanics.compiled import kernel
from services.mechanics.contact.geometry import RodGeometry, append_pairs, write_frame
from services.mechanics.contact.rows import SURFACE_SOFTNESS_M_N, ContactRows
from services.mechanics.contact.search import DuctSearch
from services.mechanics.contact.solver import UNILATERAL
from services.mechanics.effects.base import Effect
from services.mechanics.scene import SceneModel

if TYPE_CHECKING:
    from services.mechanics.simulation import Simulation


@dataclass(frozen=True, slots=True)
class GallstonesSettings:
    """Position in scene axes and radius of each stone; density, and drag of the bile they lie in."""

    position_m: tuple[tuple[float, float, float], ...] = ((20e-3, 0.0, -1e-3),)
    radius_m: tuple[float, ...] = (1.5e-3,)
    density_kg_m3: float = 1100.0
    bile_viscosity_pa_s: float = 2e-3

    def __post_init__(self) -> None:
        if len(self.position_m) != len(self.radius_m) or not all(r > 0.0 for r in self.radius_m):
            raise ValueError("effects.gallstones: each stone needs a position_m and a positive radius_m")


class Gallstones(Effect):
    """Spheres with three translations each, frictionless in their rotation, solved with the other contacts.

    Backward Euler with Stokes drag 6 pi eta r: stable for every step. Stones touch wall and catheter, not each other
    and not the tools. They weigh only where the effect ``gravity`` is named, less the bile they displace.
    """

    Settings = GallstonesSettings

    def __init__(self, settings: GallstonesSettings, scene: SceneModel) -> None:
        super().__init__(settings, scene)
        self.position_m = np.array(settings.position_m, dtype=np.float64)
        self.radius_m = np.array(settings.radius_m, dtype=np.float64)
        self.velocity_m_s = np.zeros_like(self.position_m)
        self._start_m = self.position_m.copy()
        self._start_m_s = self.velocity_m_s.copy()
        self._motion_m = np.zeros_like(self.position_m)
        volume = 4.0 / 3.0 * math.pi * self.radius_m**3
        self._mass_kg = settings.density_kg_m3 * volume
        self._submerged_kg = (settings.density_kg_m3 - 1000.0) * volume
        self._drag_n_s_m = 6.0 * math.pi * settings.bile_viscosity_pa_s * self.radius_m
        self._compliance = np.zeros(len(volume))
        self._weight_n = np.zeros_like(self.position_m)

    def prepare(self, simulation: Simulation) -> None:
        """Give every stone its own detection, for each has its radius; weigh them."""
        search = simulation.search
        if not isinstance(search, DuctSearch):
            raise ValueError("effects.gallstones: needs the collision detection of the duct")
        margin_m = simulation.scene.contact.margin_m
        self._detectors = [CatheterContactDetector(search.surface, 1, float(r), margin_m) for r in self.radius_m]
        self._pairs = ContactPairs.allocate(4)
        gravity = simulation.effects.get("gravity")
        if gravity is not None:
            self._weight_n += self._submerged_kg[:, None] * np.array(gravity.settings.acceleration_m_s2)

    def add_loads(self, simulation: Simulation, dt_s: float) -> None:
        """Predict the stones without contact."""
        self._start_m[:] = self.position_m
        self._start_m_s[:] = self.velocity_m_s
        inverse = 1.0 / (self._mass_kg + dt_s * self._drag_n_s_m)
        momentum = self._mass_kg[:, None] * self.velocity_m_s + dt_s * self._weight_n
        self.velocity_m_s[:] = inverse[:, None] * momentum
        self.position_m += dt_s * self.velocity_m_s
        self._motion_m[:] = self.position_m - self._start_m
        self._compliance[:] = dt_s**2 * inverse

    def add_rows(self, simulation: Simulation, rows: ContactRows) -> None:
        """Append stones against wall and catheter."""
        system = simulation.system
        rod = system.rod_geometry
        reach = simulation.scene.contact.margin_m + simulation.catheter.radius_m
        for stone, detector in enumerate(self._detectors):
            self._pairs.clear()
            detector.detect(self._start_m[stone : stone + 1], self._pairs)
            first = rows.n_contacts
            here = slice(stone, stone + 1)
            sphere = RodGeometry(self._start_m[here], self._motion_m[here], float(self.radius_m[stone]))
            append_pairs(
                self._pairs.arrays, self._pairs.count, system.tool_geometry, sphere, system.duct_geometry, rows
            )
            mark_sphere(rows, first, stone)
            append_on_catheter(rows, rod, sphere, stone, reach)

    def add_compliance(self, simulation: Simulation, W: FloatArray, dt_s: float) -> None:
        """Add dt^2 / m of each stone to its rows."""
        add_sphere_compliance(simulation.system.rows, self._compliance, W)

    def after_solve(self, simulation: Simulation, dt_s: float) -> None:
        """Apply the contact forces."""
        system = simulation.system
        change = sphere_forces(system.rows, system.force_n, np.zeros_like(self.position_m))
        change *= self._compliance[:, None]
        self.position_m += change
        self.velocity_m_s += change / dt_s
        drag_power_w = self._drag_n_s_m @ np.sum(self.velocity_m_s**2, axis=1)
        lost_by_step_j = 0.5 * self._mass_kg @ np.sum((self.velocity_m_s - self._start_m_s) ** 2, axis=1)
        self.dissipated_j += float(dt_s * drag_power_w + lost_by_step_j)

    def potential_energy_j(self, simulation: Simulation) -> float:
        """Kinetic energy of the stones, and what their weight has stored, zero at the origin."""
        kinetic_j = 0.5 * self._mass_kg @ np.sum(self.velocity_m_s**2, axis=1)
        return float(kinetic_j - np.sum(self._weight_n * self.position_m))


@kernel
def mark_sphere(rows: ContactRows, first: int, stone: int) -> None:
    """Turn rows from ``first`` on, built with a stone in the place of a particle, into rows of that stone."""
    for row in range(first, rows.used[0]):
        rows.rod_weight[row, 0] = rows.rod_weight[row, 1] = 0.0
        rows.sphere[row], rows.sphere_sign[row] = stone, 1.0
        rows.body[row] |= (stone + 1) << 30
        rows.identity[row] |= (stone + 1) << 54


@kernel
def append_on_catheter(rows: ContactRows, rod: RodGeometry, sphere: RodGeometry, stone: int, reach: float) -> None:
    """Append the stone against the closest point of each catheter segment within ``reach`` of its surface."""
    centre = sphere.position[0]
    for segment in range(rod.position.shape[0] - 1):
        row = rows.used[0]
        if row == rows.gap_m.shape[0]:
            return
        along, length_2 = 0.0, 0.0
        for axis in range(3):
            edge = rod.position[segment + 1, axis] - rod.position[segment, axis]
            along += edge * (centre[axis] - rod.position[segment, axis])
            length_2 += edge * edge
        s = min(max(along / length_2, 0.0), 1.0)
        # A particle between two segments belongs to the one before it, the tip to the last.
        if s == 0.0 and segment > 0:
            continue
        normal = rows.frame[row, 0]
        distance_2 = 0.0
        for axis in range(3):
            point = (1.0 - s) * rod.position[segment, axis] + s * rod.position[segment + 1, axis]
            normal[axis] = centre[axis] - point
            distance_2 += normal[axis] ** 2
        distance = math.sqrt(distance_2)
        if distance == 0.0 or distance > sphere.radius + reach:
            continue
        for axis in range(3):
            normal[axis] /= distance
            rows.point_m[row, axis] = centre[axis] - sphere.radius * normal[axis]
            rows.slip_m[row, axis] = sphere.motion[0, axis] - (
                (1.0 - s) * rod.motion[segment, axis] + s * rod.motion[segment + 1, axis]
            )
        write_frame(normal, rows.frame[row])
        rows.kind[row], rows.tool[row], rows.limit[row] = UNILATERAL, NO_TOOL, 0.0
        rows.gap_m[row] = distance - sphere.radius - rod.radius
        rows.softness_m_n[row] = SURFACE_SOFTNESS_M_N
        rows.duct_weight[row] = 0.0
        rows.rod_weight[row] = 0.0
        rows.rod_node[row, 2], rows.rod_node[row, 3] = segment, segment + 1
        rows.rod_weight[row, 2], rows.rod_weight[row, 3] = s - 1.0, -s
        rows.sphere[row], rows.sphere_sign[row] = stone, 1.0
        rows.body[row] = ((stone + 1) << 30) + 1
        rows.identity[row] = ((stone + 1) << 54) + (1 << 24) + segment
        rows.used[0] = row + 1


@kernel
def add_sphere_compliance(rows: ContactRows, compliance: FloatArray, W: FloatArray) -> None:
    """Add the compliance of each stone between all rows it takes part in, lower blocks, world axes."""
    for a in range(rows.used[0]):
        for b in range(a + 1):
            if rows.sphere[a] >= 0 and rows.sphere[a] == rows.sphere[b]:
                value = compliance[rows.sphere[a]] * rows.sphere_sign[a] * rows.sphere_sign[b]
                for axis in range(3):
                    W[3 * a + axis, 3 * b + axis] += value


@kernel
def sphere_forces(rows: ContactRows, forces: FloatArray, out: FloatArray) -> FloatArray:
    """Add the contact forces on the stones to ``out`` (s, 3) and return it."""
    for row in range(rows.used[0]):
        if rows.sphere[row] >= 0:
            for axis in range(3):
                out[rows.sphere[row], axis] += rows.sphere_sign[row] * forces[row, axis]
    return out
