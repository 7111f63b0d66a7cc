"""Gallstones: rigid spheres in the duct that catheter and wall push about."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.spheres import MAX_SPHERES, add_sphere_forces
from trocar.services.mechanics.effects.base import Effect, require_not_negative, require_positive
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class GallstonesSettings:
    """Position in scene axes and radius of each stone; density, and drag of the bile they lie in."""

    position_m: tuple[tuple[float, float, float], ...] = ((20e-3, 0.0, -1e-3),)
    radius_m: tuple[float, ...] = (1.5e-3,)
    density_kg_m3: float = 1100.0
    bile_viscosity_pa_s: float = 2e-3

    def __post_init__(self) -> None:
        if len(self.position_m) != len(self.radius_m) or not all(r > 0.0 for r in self.radius_m):
            raise ValueError("each stone needs a position_m and a positive radius_m")
        if len(self.radius_m) > MAX_SPHERES:
            raise ValueError(f"{len(self.radius_m)} stones are too many to be told apart, at most {MAX_SPHERES}")
        require_positive(self, "density_kg_m3")
        require_not_negative(self, "bile_viscosity_pa_s")


class Stones(Struct):
    """State of s spheres now and at the start of the step, and their loads."""

    position: Annotated[FloatArray, "s", 3]
    velocity: Annotated[FloatArray, "s", 3]
    start: Annotated[FloatArray, "s", 3]
    start_velocity: Annotated[FloatArray, "s", 3]
    motion: Annotated[FloatArray, "s", 3]  # in the step, without contacts
    change: Annotated[FloatArray, "s", 3]
    weight: Annotated[FloatArray, "s", 3]
    mass: Annotated[FloatArray, "s"]
    drag: Annotated[FloatArray, "s"]
    compliance: Annotated[FloatArray, "s"]


stones_at = reader(Stones)


class Gallstones(Effect):
    """Spheres with three translations each, frictionless in their rotation, solved with the other contacts.

    Backward Euler with Stokes drag 6 pi eta r: stable for every step. Stones touch wall and catheter, not each other
    and not the tools. They weigh only where the effect ``gravity`` is named, less the bile they displace.
    """

    Settings = GallstonesSettings

    def __init__(self, settings: GallstonesSettings, scene: SceneModel) -> None:
        super().__init__(settings, scene)
        self.radius_m = np.array(settings.radius_m, dtype=np.float64)
        volume = 4.0 / 3.0 * math.pi * self.radius_m**3
        self._submerged_kg = (settings.density_kg_m3 - 1000.0) * volume
        position_m = np.array(settings.position_m, dtype=np.float64)
        self._stones = stones = Stones.zeros(
            s=len(volume),
            position=position_m,
            start=position_m.copy(),
            mass=settings.density_kg_m3 * volume,
            drag=6.0 * math.pi * settings.bile_viscosity_pa_s * self.radius_m,
        )
        self.position_m, self.velocity_m_s = stones.position, stones.velocity
        self._share = 1.0

    def place_bodies(self, world: World) -> None:
        """Register the stones with contact detection, where they begin."""
        here, spheres, stones = world.add_spheres(self.radius_m), world.system.geometry.spheres, self._stones
        self._first = here.start
        stones.start, stones.motion = spheres.start[here], spheres.motion[here]
        stones.compliance = spheres.compliance[here]
        stones.start[:] = stones.position

    def prepare(self, world: World) -> None:
        """Compute the stones' weights."""
        stones = self._stones
        stones.weight += self._submerged_kg[:, None] * world.acceleration_m_s2

    def add_loads(self, world: World, dt_s: float) -> None:
        """Predict the stones without contact."""
        predict_stones(self._stones.address, dt_s)

    def after_solve(self, world: World, dt_s: float) -> None:
        """Apply the contact forces."""
        system = world.system
        stones, share = self._stones, self._share
        self._dissipated_j += push_stones(stones.address, (system.rows.address, self._first), system.force_n, dt_s)
        if share < 1.0:
            stones.position[:] = stones.start + share * (stones.position - stones.start)
            stones.velocity[:] = stones.start_velocity + share * (stones.velocity - stones.start_velocity)
            self._share = 1.0

    def take_back(self, world: World, share: float) -> None:
        """Let the stones move by the same share of their motion."""
        self._share = share

    def state_arrays(self) -> tuple[FloatArray, ...]:
        """Return positions and velocities of the stones."""
        return self.position_m, self.velocity_m_s

    def sphere_radii_m(self) -> tuple[float, ...]:
        """Return the radii of the stones."""
        return tuple(self.radius_m.tolist())

    def sphere_places_m(self) -> FloatArray:
        """Return where the stones are now (s, 3)."""
        return self.position_m

    def potential_energy_j(self, world: World) -> float:
        """Return kinetic energy and potential energy of weight of the stones, zero at the origin."""
        kinetic_j = 0.5 * self._stones.mass @ np.sum(self.velocity_m_s**2, axis=1)
        return float(kinetic_j - np.sum(self._stones.weight * self.position_m))


@kernel
def predict_stones(address: Address[Stones], dt_s: float) -> None:
    """Move the stones by weight and drag alone, and write the compliance of each."""
    stones = stones_at(address)
    for stone in range(stones.mass.shape[0]):
        inverse = 1.0 / (stones.mass[stone] + dt_s * stones.drag[stone])
        stones.compliance[stone] = dt_s * dt_s * inverse
        for axis in range(3):
            start, before = stones.position[stone, axis], stones.velocity[stone, axis]
            velocity = inverse * (stones.mass[stone] * before + dt_s * stones.weight[stone, axis])
            stones.start[stone, axis], stones.start_velocity[stone, axis] = start, before
            stones.velocity[stone, axis], stones.position[stone, axis] = velocity, start + dt_s * velocity
            stones.motion[stone, axis] = stones.position[stone, axis] - start


@kernel
def push_stones(
    address: Address[Stones], rows: tuple[Address[ContactRows], int], forces: FloatArray, dt_s: float
) -> float:
    """Move the stones by the contact forces (k, 3); return the energy dissipated by drag and the implicit step, in J.

    ``rows`` is (the contacts, the index of the first stone among their spheres).
    """
    stones, lost_j = stones_at(address), 0.0
    stones.change[:] = 0.0
    add_sphere_forces(rows[0], forces, stones.change, rows[1])
    for stone in range(stones.mass.shape[0]):
        for axis in range(3):
            change = stones.compliance[stone] * stones.change[stone, axis]
            stones.position[stone, axis] += change
            stones.velocity[stone, axis] += change / dt_s
            velocity = stones.velocity[stone, axis]
            lost_j += dt_s * stones.drag[stone] * velocity * velocity
            lost_j += 0.5 * stones.mass[stone] * (velocity - stones.start_velocity[stone, axis]) ** 2
    return lost_j
