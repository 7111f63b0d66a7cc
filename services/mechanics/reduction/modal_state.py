"""Modal coordinates of the reduced duct and what their integrators promise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trocar.services.mechanics.arrays import FloatArray


@dataclass(slots=True)
class ModalState:
    """Modal coordinates q (r,), their rates qdot (r,) and accelerations qddot (r,), mass normalised (m kg^1/2)."""

    q: FloatArray
    qdot: FloatArray
    qddot: FloatArray

    @classmethod
    def at_rest(cls, n_modes: int) -> ModalState:
        """Return the undeformed state of ``n_modes`` modes."""
        return cls(np.zeros(n_modes), np.zeros(n_modes), np.zeros(n_modes))

    def copy(self) -> ModalState:
        """Return an independent copy."""
        return ModalState(self.q.copy(), self.qdot.copy(), self.qddot.copy())

    def kinetic_energy_j(self) -> float:
        """Kinetic energy in J: mass normalised modes carry unit mass."""
        return 0.5 * float(self.qdot @ self.qdot)

    def strain_energy_j(self, omega_rad_s: FloatArray) -> float:
        """Elastic energy in J of the linear modes."""
        return 0.5 * float(np.sum((omega_rad_s * self.q) ** 2))


@dataclass(frozen=True, slots=True)
class ModalGains:
    """What a modal force f (r,), applied over one step, adds at its end: dq = position f, and so on.

    All three are (r,) and linear in f, so the contact compliance of the duct at the end of a step is
    ``Phi_c diag(position) Phi_c^T``, plus the residual compliance.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class ModalIntegrator(Protocol):
    """One step of r decoupled oscillators, first without and then with the contact forces."""

    def predict(self, state: ModalState, modal_force: FloatArray, dt_s: float) -> None:
        """Step ``state`` in place under ``modal_force`` (r,), contacts left out."""

    def gains(self, dt_s: float) -> ModalGains:
        """Return the linear effect of a modal force on the state at the end of a step."""


class PreparedIntegrator:
    """An integrator of constant coefficients: they are evaluated anew only for a step of another length."""

    def __init__(self) -> None:
        self._dt_s = float("nan")
        self._gains: ModalGains

    def gains(self, dt_s: float) -> ModalGains:
        """Return the change of the end state per unit modal force in a step of ``dt_s``.

        Raises ValueError if the step has no length.
        """
        if dt_s != self._dt_s:
            self._prepare(dt_s)
        return self._gains

    def _prepare(self, dt_s: float) -> None:
        if not dt_s > 0.0:
            raise ValueError(f"the time step must be positive, not {dt_s} s")
        self._gains = self._evaluate(dt_s)
        self._dt_s = dt_s

    def _evaluate(self, dt_s: float) -> ModalGains:
        """Evaluate what a step of ``dt_s`` takes, and return what it makes of a force."""
        raise NotImplementedError
