"""The implicit integrator: one banded factorisation per step, stable at 1 ms for the stiffness of a real catheter."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.rod import contact_response, implicit_kernels
from trocar.services.mechanics.rod.banded import empty_columns
from trocar.services.mechanics.rod.contact_energy_gain import remove_energy_gain_with_twist
from trocar.services.mechanics.rod.frame_step import predict_with_frame, step_freely_with_frame
from trocar.services.mechanics.rod.free_step import NOT_DEFINITE, SLEPT, FreeStep, step_freely
from trocar.services.mechanics.rod.model import RodModel, allocate_work, build_model
from trocar.services.mechanics.rod.properties import RodProperties
from trocar.services.mechanics.rod.state import RodState
from trocar.services.mechanics.rod.step_gains import StepGains
from trocar.services.mechanics.rod.supports import Supports
from trocar.services.mechanics.rod.twist import TwistModel, build_twist_model, frame_task

SPECTRAL_RADIUS = 0.6


class ImplicitIntegrator(StepGains):
    """Generalized-alpha on the particles, second order, by guarded Newton iterations; contacts by implicit Euler.

    An iteration solves ``A dv = dt f``, with A the banded sum of mass, damping and the positive semidefinite tangent
    stiffness, and f the forces in the middle of the step, at the inertial prediction. One iteration is enough if a step
    rotates segments by little. If the linearisation would cause spurious stretch (an impact, a jump of the hand), more
    are taken, at most ``max_iterations``. ``iterations`` is the number that the last step took.

    ``spectral_radius`` rho, 0 to 1, sets the numerical damping: it is the factor by which a step changes vibrations of
    infinite frequency. 1 is the midpoint rule, which conserves energy. Below 1, a mode of angular frequency omega has
    the additional damping ratio ``e^3 (omega dt)^3/2`` with e = (1 - rho)/(1 + rho), if omega dt is small. In the
    linear regime every step is stable. Linear momentum is conserved exactly, angular momentum nearly.

    Contact forces are discontinuous, and are integrated by implicit Euler instead (Chen, Acary, Virlez and Bruls 2013):
    `correct` changes velocities by ``dt B^-1 f`` and positions by dt times that, with B = M + dt C + dt^2 K, so that a
    contact comes to rest without a rebound. A force that lasts belongs in `predict`, which holds it constant over the
    step, and its change in `correct`.

    The first step of a state, and a step in which segments rotate too far, are taken by implicit Euler, which allows
    velocities that are not smooth.

    Call `predict`, then any number of `solve`, `compliance` and `correct`. The first of these factorises B.
    """

    def __init__(
        self,
        properties: RodProperties,
        supports: Supports | None = None,
        *,
        spectral_radius: float = SPECTRAL_RADIUS,
        max_iterations: int = 8,
    ) -> None:
        if not 0.0 <= spectral_radius <= 1.0:
            raise ValueError(f"spectral_radius is {spectral_radius}; the step is stable from 0 to 1")
        if max_iterations < 1:
            raise ValueError(f"max_iterations is {max_iterations}; a step takes at least one Newton iteration")
        self.properties = properties
        self.model: RodModel = build_model(properties, supports or Supports())
        self.twist: TwistModel | None = build_twist_model(properties, self.model.walls)
        self.spectral_radius = spectral_radius
        self.max_iterations = max_iterations
        self.iterations = 0
        n = properties.n_particles
        self.work = allocate_work(n, 0 if self.twist is None else len(self.twist.torsion))
        if self.twist is not None:
            self.work.first_joint = self.twist.first
            self.model.has_frame = True
        self.addresses = (self.model.address, self.work.address)
        self.held_target_m: FloatArray = np.full((len(self.model.held), 3), np.nan)
        self._frame_step = np.zeros((7, n, 3))
        self._columns = empty_columns(3 * n)
        self._dt_s = 0.0
        self.is_factored = False

    def predict(self, state: RodState, external_force_n: FloatArray, dt_s: float) -> None:
        """Advance ``state`` in place by ``dt_s`` under external forces (n, 3), constant over the step.

        Raises FloatingPointError if the state or a force is not finite; ``state`` is then unchanged.
        """
        self._dt_s = dt_s
        self.is_factored = False
        is_start = state.slow_velocity_m_s is None
        if state.slow_velocity_m_s is None:
            state.slow_velocity_m_s = np.zeros_like(state.velocity_m_s)
        motion = (state.position_m, state.velocity_m_s, state.slow_velocity_m_s)
        step = (dt_s, self.spectral_radius, self.max_iterations, is_start)
        load = external_force_n, self.held_target_m
        if self.twist is None:
            self.iterations = implicit_kernels.predict(self.addresses, motion, *load, step)
        else:
            rod = self.addresses, frame_task(self.twist, state)
            self.iterations = predict_with_frame(rod, self._frame_step, motion, load, step)
        if self.iterations == 0:
            raise FloatingPointError("the rod's state or a force on it is not finite")

    def step_freely(self, state: RodState, address: Address[FreeStep], dt_s: float, flags: tuple[bool, bool]) -> bool:
        """Do as `predict` and `correct` do, in one kernel; return whether the rod slept.

        ``flags`` are those of `free_step.step_freely`.
        Raises FloatingPointError if the state or a force is not finite.
        """
        slow = state.slow_velocity_m_s
        is_start = slow is None
        if slow is None:
            slow = np.zeros_like(state.velocity_m_s)
        motion = (state.position_m, state.velocity_m_s, slow)
        step = (dt_s, self.spectral_radius, self.max_iterations, is_start)
        if self.twist is None:
            taken = step_freely(address, self.addresses, motion, self.held_target_m, step, flags)
        else:
            rod, scratch = (self.addresses, frame_task(self.twist, state)), (self._frame_step, self.held_target_m)
            taken = step_freely_with_frame(address, rod, scratch, motion, step, flags)
        if taken == SLEPT:
            return True
        state.slow_velocity_m_s = slow
        self._dt_s, self.iterations = dt_s, max(taken, 0)
        self.note_factors(taken != NOT_DEFINITE)
        self.is_factored = flags[0]
        if taken == 0:
            raise FloatingPointError("the rod's state or a force on it is not finite")
        return False

    def solve(self, force_n: FloatArray, out: FloatArray) -> None:
        """Fill ``out`` (n, 3, m) with the end-of-step position changes of ``force_n`` (n, 3, m), m right-hand sides."""
        self._factor()
        contact_response.solve_many(
            self.model.address, self.work.band, self.position_gain_s2, self._columns, force_n, out
        )

    def compliance(self, particles: IntArray, out: FloatArray) -> None:
        """Fill ``out`` (3k, 3k) with the end-of-step position change of k particles per unit force on each [m/N].

        ``particles`` (k,) ascending and distinct. Symmetric positive semidefinite; zero rows for held particles.
        """
        self._factor()
        contact_response.compliance(
            self.model.address, self.work.band, self.position_gain_s2, self._columns, particles, out
        )

    def correct(self, state: RodState, contact_force_n: FloatArray) -> None:
        """Add to ``state`` in place the change by contact forces (n, 3), which act as impulses over the step."""
        motion, step = (state.position_m, state.velocity_m_s), (self._dt_s, self.is_factored)
        self.note_factors(contact_response.correct(self.addresses, motion, contact_force_n, step))

    def _factor(self) -> None:
        """Factorise B, unless that is done."""
        if not self.is_factored:
            self.note_factors(contact_response.factor_for_contacts(self.addresses, self._dt_s))

    def remove_energy_gain(self, state: RodState, address: Address[FreeStep]) -> None:
        """Remove a corrected step's energy gain from the velocities of a rod with twist (`contact_energy_gain`)."""
        assert self.twist is not None
        task, motion = frame_task(self.twist, state), (state.position_m, state.velocity_m_s)
        remove_energy_gain_with_twist(self.addresses, address, motion, self._dt_s, task)

    def note_factors(self, is_factored: bool) -> None:
        """Store whether B is factorised. Raises FloatingPointError if it could not be."""
        self.is_factored = is_factored
        if not is_factored:
            raise FloatingPointError("the rod's state is not finite")
