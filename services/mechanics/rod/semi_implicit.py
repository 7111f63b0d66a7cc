"""The paper's integrator: semi-implicit Euler on the particles, substepped below its stability limit."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.rod.forces import add_internal_forces
from trocar.services.mechanics.rod.implicit_kernels import Addresses, Motion
from trocar.services.mechanics.rod.model import RodModel, RodWork, allocate_work, build_model, model_at, work_at
from trocar.services.mechanics.rod.properties import RodProperties
from trocar.services.mechanics.rod.stability import stable_time_step
from trocar.services.mechanics.rod.state import RodState
from trocar.services.mechanics.rod.step_gains import StepGains
from trocar.services.mechanics.rod.supports import Supports
from trocar.services.mechanics.rod.twist import TwistModel, add_frame_forces, build_twist_model

SAFETY = 0.9  # fraction of the computed limit, because a strong tension adds geometric stiffness


class SemiImplicitIntegrator(StepGains):
    """Basdogan et al. 2001, eq. (27)-(28): ``v += h F/m``, then ``x += h v``, F = springs + bending springs - b v.

    The method is of first order and explicit. It is stable only below ``stable_time_step_s``, about the time that a
    stretch wave takes along one segment (6 us for a polyethylene catheter of 50 segments). So a step is divided into
    equal substeps below 0.9 of this limit; a step that needs more than ``max_substeps`` is refused. Internal damping is
    explicit too: it shortens the limit to about 2/(beta omega^2), which is soon unaffordable. The paper has viscous
    drag only. The method is symplectic: without damping the energy of a free rod oscillates but does not drift, and
    momenta are conserved to rounding.

    `predict`, `solve`, `compliance` and `correct` are those of `ImplicitIntegrator` with A = M, because in an explicit
    step only the mass of the touched particle resists a contact.
    """

    def __init__(
        self, properties: RodProperties, supports: Supports | None = None, *, max_substeps: int = 1000
    ) -> None:
        self.properties = properties
        self.model: RodModel = build_model(properties, supports or Supports())
        self.twist: TwistModel | None = build_twist_model(properties, self.model.walls)
        self.work = allocate_work(properties.n_particles)
        self.max_substeps = max_substeps
        self.stable_time_step_s = stable_time_step(self.model)
        self.held_target_m: FloatArray = np.full((len(self.model.held), 3), np.nan)
        self._external = np.zeros((properties.n_particles, 3)) if self.twist is not None else np.zeros((0, 3))
        self._free_inverse_mass = np.where(self.model.is_held, 0.0, 1.0 / self.model.mass)
        self._dt_s = 0.0

    def substeps(self, dt_s: float) -> int:
        """Return the number of equal substeps of a step of ``dt_s``.

        Raises ValueError if it exceeds ``max_substeps``.
        """
        limit_s = SAFETY * self.stable_time_step_s
        count = max(math.ceil(dt_s / limit_s), 1)
        if count > self.max_substeps:
            raise ValueError(
                f"semi_implicit is stable up to {limit_s:.3g} s for this rod: a step of {dt_s:.3g} s takes {count} "
                f"substeps, more than {self.max_substeps}; use implicit, or lower EA or internal_damping_s"
            )
        return count

    def predict(self, state: RodState, external_force_n: FloatArray, dt_s: float) -> None:
        """Advance ``state`` in place by ``dt_s`` under external forces (n, 3) alone, held constant over the substeps.

        Raises FloatingPointError if the state or a force is not finite; ``state`` is then lost.
        """
        self._dt_s = dt_s
        if self.twist is not None:
            np.copyto(self._external, external_force_n)
            add_frame_forces(self.twist, state, self._external)
            external_force_n = self._external
        motion = (state.position_m, state.velocity_m_s)
        step = (dt_s, self.substeps(dt_s))
        addresses = (self.model.address, self.work.address)
        if not take_substeps(addresses, motion, external_force_n, self.held_target_m, step):
            raise FloatingPointError("the rod's state or a force on it is not finite")

    def solve(self, force_n: FloatArray, out: FloatArray) -> None:
        """Fill ``out`` (n, 3, m) with the end-of-step position changes of ``force_n`` (n, 3, m), m right-hand sides."""
        np.multiply(force_n, (self.position_gain_s2 * self._free_inverse_mass)[:, None, None], out=out)

    def compliance(self, particles: IntArray, out: FloatArray) -> None:
        """Fill ``out`` (3k, 3k) with the end-of-step position change of k particles per unit force on each [m/N]."""
        out[:] = 0.0
        np.fill_diagonal(out, np.repeat(self.position_gain_s2 * self._free_inverse_mass[particles], 3))

    def correct(self, state: RodState, contact_force_n: FloatArray) -> None:
        """Add to ``state`` in place its change by contact forces (n, 3), applied as one impulse over the step."""
        impulse = self._dt_s * self._free_inverse_mass[:, None] * contact_force_n
        state.velocity_m_s += impulse
        state.position_m += self._dt_s * impulse


@kernel
def take_substeps(
    addresses: Addresses, motion: Motion, external: FloatArray, target: FloatArray, step: tuple[float, int]
) -> bool:
    """Take all substeps; return False if a number is not finite."""
    model, work = model_at(addresses[0]), work_at(addresses[1])
    dt_s, substeps = step
    _set_held_velocity(model, motion, target, dt_s)
    for _ in range(substeps):
        _semi_implicit_euler(model, work, motion, external, dt_s / substeps)
    size = 0.0
    for i in range(model.mass.shape[0]):
        for c in range(3):
            size += abs(motion[0][i, c]) + abs(motion[1][i, c])
    return math.isfinite(size)


@kernel
def _set_held_velocity(model: RodModel, motion: Motion, target: FloatArray, dt_s: float) -> None:
    x, v = motion
    for k in range(model.held.shape[0]):
        i = model.held[k]
        for c in range(3):
            v[i, c] = 0.0 if np.isnan(target[k, c]) else (target[k, c] - x[i, c]) / dt_s


@kernel
def _semi_implicit_euler(model: RodModel, work: RodWork, motion: Motion, external: FloatArray, h: float) -> None:
    """Apply eq. (28) once, with the forces of eq. (27) at the old positions and velocities."""
    x, v = motion
    for i in range(x.shape[0]):
        for c in range(3):
            work.position[i, c] = x[i, c]
            work.lead[0, i, c] = model.beta * v[i, c]
            work.force[i, c] = external[i, c] - model.drag[i] * v[i, c]
    add_internal_forces(model, work, (0.0, 0.0))
    for i in range(x.shape[0]):
        inverse_mass = 0.0 if model.is_held[i] else 1.0 / model.mass[i]
        for c in range(3):
            v[i, c] += h * work.force[i, c] * inverse_mass
            x[i, c] += h * v[i, c]
