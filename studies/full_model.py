"""Time integration of the full, unreduced duct: the reference, and the paper's cost comparison."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import LinearOperator, eigsh

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.reduction.modal_state import ModalState


@dataclass(frozen=True, slots=True)
class NewmarkConstants:
    """The paper's a0 ... a10 for one step length and the damping B = alpha M, alpha in 1/s."""

    a0: float
    a1: float
    a2: float
    a3: float
    a4: float
    a5: float
    a6: float
    a7: float
    a8: float
    a9: float
    a10: float

    @classmethod
    def from_step(cls, dt_s: float, alpha_1_s: float) -> NewmarkConstants:
        """Evaluate the constants of Appendix B.A for the step ``dt_s`` in s (eta = 1/4, delta = 1/2)."""
        a0 = (4.0 + 2.0 * alpha_1_s * dt_s) / dt_s**2
        a4 = 4.0 / dt_s**2
        a9 = dt_s**2 / 4.0
        return cls(a0, a0, 4.0 / dt_s + alpha_1_s, 1.0, a4, -a4, -a4 * dt_s, -1.0, dt_s / 2.0, a9, a9)


class DirectNewmark:
    """The paper's DNIOS: Newmark average acceleration of M u'' + B u' + K u = F on all free dofs.

    B = alpha M as in Appendix B, plus beta K, which the paper has not. One sparse factorisation for one step
    length, one back-substitution a step. Unconditionally stable; conserves energy where B = 0.

    Attributes:
        u, v, a: (d,) float64. Displacement, velocity and acceleration of the free dofs at the current time; rotations
            are massless and follow.
    """

    def __init__(self, model: ShellModel, dt_s: float, alpha_1_s: float = 0.0, beta_s: float = 0.0) -> None:
        self._model = model
        self._constants = NewmarkConstants.from_step(dt_s, alpha_1_s)
        self._dt_s = dt_s
        self._alpha = alpha_1_s
        self._beta = beta_s
        stiffening = 1.0 + 2.0 * beta_s / dt_s
        self._factor = factorise(
            csc_array(stiffening * model.K_free + diags_array(self._constants.a0 * model.free_mass_kg))
        )
        self.u, self.v, self.a = np.zeros((3, len(model.free_dofs)))

    def step(self, forces_n: FloatArray) -> None:
        """Advance by one step under nodal forces (n, 3) in N that act at its end (Appendix B, steps 1 to 3)."""
        c, u, v, a = self._constants, self.u, self.v, self.a
        load = free_load(self._model, forces_n) + self._model.free_mass_kg * (c.a1 * u + c.a2 * v + c.a3 * a)
        if self._beta:
            load += self._beta * np.asarray(self._model.K_free @ (2.0 / self._dt_s * u + v))
        u_hat = self._factor.solve(load)
        a_end = c.a4 * u_hat + c.a5 * u + c.a6 * v + c.a7 * a
        self.v = v + c.a8 * (a + a_end)
        self.u = u + self._dt_s * v + c.a9 * a + c.a10 * a_end
        self.a = a_end

    def reaction_force(self) -> FloatArray:
        """Return M a + B v + K u as nodal forces (n, 3) in N: what the user feels (Appendix B, step 4)."""
        model = self._model
        force = model.free_mass_kg * (self.a + self._alpha * self.v) + model.K_free @ (self.u + self._beta * self.v)
        return nodal_translations(model, force)

    def displacements(self) -> FloatArray:
        """Return the displacement of every node (n, 3) in m."""
        return nodal_translations(self._model, self.u)

    def energy_j(self) -> float:
        """Return kinetic plus elastic energy in J."""
        kinetic = 0.5 * float(self._model.free_mass_kg @ self.v**2)
        return kinetic + 0.5 * float(self.u @ np.asarray(self._model.K_free @ self.u))


class CentralDifference:
    """Explicit central difference of the full duct, rotations eliminated by a sparse solve each step.

    Conditionally stable: the step may not exceed T_n / pi = 2 / omega_max (paper V.C.1 i; Bathe). The limit is
    computed from the highest frequency and enforced.
    Raises ValueError if the step is beyond the stability limit, which the message names.
    """

    def __init__(self, model: ShellModel, dt_s: float, alpha_1_s: float = 0.0) -> None:
        self._condensed = CondensedStiffness(model)
        limit_s = self._condensed.stable_step_s()
        if not 0.0 < dt_s <= limit_s:
            raise ValueError(f"central difference is stable up to {limit_s:.3g} s, not at {dt_s:.3g} s")
        self._model = model
        self._dt_s = dt_s
        self._mass = model.free_mass_kg[self._condensed.translations]
        self._alpha = alpha_1_s
        self.u, self._previous = np.zeros((2, self._mass.size))

    def step(self, forces_n: FloatArray) -> None:
        """Advance by one step under nodal forces (n, 3) in N that act at its beginning."""
        dt, half_damping = self._dt_s, 0.5 * self._alpha * self._dt_s
        force = free_load(self._model, forces_n)[self._condensed.translations]
        acceleration = (force - self._condensed.apply(self.u)) / self._mass
        following = dt**2 * acceleration + 2.0 * self.u - (1.0 - half_damping) * self._previous
        self.u, self._previous = following / (1.0 + half_damping), self.u

    def displacements(self) -> FloatArray:
        """Return the displacement of every node (n, 3) in m."""
        vector = np.zeros(len(self._model.free_dofs))
        vector[self._condensed.translations] = self.u
        return nodal_translations(self._model, vector)


class CondensedStiffness:
    """K_tt - K_tr K_rr^-1 K_rt (paper eq. 16) as an operator, never formed."""

    def __init__(self, model: ShellModel) -> None:
        self.translations = np.flatnonzero(model.free_mass_kg > 0.0)
        rotations = np.flatnonzero(model.free_mass_kg == 0.0)
        K = model.K_free.tocsr()
        self._K_tt = K[self.translations][:, self.translations]
        self._K_tr = K[self.translations][:, rotations]
        self._K_rt = K[rotations][:, self.translations]
        self._rotations = factorise(csc_array(K[rotations][:, rotations])) if rotations.size else None
        self._mass = model.free_mass_kg[self.translations]

    def apply(self, u: FloatArray) -> FloatArray:
        """Return the elastic force on the translations for displacements u of them."""
        force: FloatArray = np.asarray(self._K_tt @ u)
        if self._rotations is not None:
            rotations = self._rotations.solve(np.asarray(self._K_rt @ u))
            force -= np.asarray(self._K_tr @ rotations)
        return force

    def stable_step_s(self) -> float:
        """Return 2 / omega_max in s, from the highest eigenvalue of the condensed system."""
        root = 1.0 / np.sqrt(self._mass)
        size = root.size
        operator = LinearOperator((size, size), matvec=lambda x: root * self.apply(root * x.ravel()), dtype=float)
        start = np.random.default_rng(0).standard_normal(size)
        highest = eigsh(operator, k=1, which="LA", v0=start, return_eigenvectors=False, tol=1e-6)
        return 2.0 / float(np.sqrt(highest[0] * (1.0 + 1e-6)))


def rayleigh_damping_ratio(omega_rad_s: FloatArray, alpha_1_s: float, beta_s: float) -> FloatArray:
    """Return the damping ratios (r,) of B = alpha M + beta K; the paper has beta = 0."""
    return 0.5 * (alpha_1_s / omega_rad_s + beta_s * omega_rad_s)


def modal_reaction(state: ModalState, omega_rad_s: FloatArray, damping_ratio: FloatArray) -> FloatArray:
    """Return f = q'' + 2 omega zeta q' + omega^2 q (r,): the modal force the state balances (Appendix B, step 4)."""
    damping = 2.0 * omega_rad_s * damping_ratio
    reaction: FloatArray = state.qddot + damping * state.qdot + omega_rad_s**2 * state.q
    return reaction
