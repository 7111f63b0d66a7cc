"""Natural modes by Lanczos iteration on the sparse factors, with massless rotations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.shell_model import ShellModel


@dataclass(frozen=True)
class EigenModes:
    """Lowest natural modes in ascending order, mass normalised: sum over nodes of mass |Phi|² is one.

    Attributes:
        omega_rad_s: (r,) natural frequencies.
        Phi: (n, 3, r) translations, zero at held dofs.
        rotations: (n, 3, r) rotation vectors that go with them, rad per unit of modal coordinate.
    """

    omega_rad_s: FloatArray
    Phi: FloatArray
    rotations: FloatArray

    @property
    def frequency_hz(self) -> FloatArray:
        """(r,) natural frequencies in Hz."""
        return self.omega_rad_s / (2.0 * np.pi)


def check_n_modes(model: ShellModel, n_modes: int) -> None:
    """Raise ValueError if a model has no ``n_modes`` modes."""
    n = len(model.free_translations)
    if n < 2:
        raise ValueError(f"n_modes cannot be had, the supports leave {n} translations free")
    if not 0 < n_modes < n:
        raise ValueError(f"n_modes must lie between 1 and {n - 1}, the free translations, is {n_modes}")


def compute_modes(model: ShellModel, n_modes: int, on_solve: Callable[[], None] | None = None) -> EigenModes:
    """Lowest ``n_modes`` of K phi = omega² M phi where M has no entries for rotations (paper eq. 19).

    Solving with the full K and reading only translations is multiplication by the inverse of the condensed
    stiffness (paper eq. 15-16), so Lanczos on M^1/2 K⁻¹ M^1/2 restricted to translations is exactly the
    condensed problem, without its dense matrix.
    Raises ValueError if more modes are asked for than the model has free translations, or the model is ill-conditioned.

    Args:
        model, n_modes: What is solved, and how far.
        on_solve: Called at every solve with the factors, of which there are about two to four per mode: for progress.
    """
    check_n_modes(model, n_modes)
    translations = model.free_translations
    n = len(translations)
    model.check_condition()
    root_mass = np.sqrt(model.free_mass_kg[translations])
    full = np.zeros(len(model.free_dofs))

    def flexibility(y: FloatArray) -> FloatArray:
        if on_solve is not None:
            on_solve()
        full[translations] = root_mass * y
        result: FloatArray = root_mass * model.factor.solve(full)[translations]
        return result

    operator = scipy.sparse.linalg.LinearOperator((n, n), matvec=flexibility, dtype=np.float64)
    start = np.random.default_rng(1).standard_normal(n)
    values, vectors = scipy.sparse.linalg.eigsh(operator, n_modes, which="LM", v0=start)
    if values.min() <= 0.0:
        raise np.linalg.LinAlgError("stiffness is not positive definite, a natural frequency is not real")
    order = np.argsort(-values)
    omega = 1.0 / np.sqrt(values[order])
    return expand_to_nodes(model, omega, vectors[:, order] / root_mass[:, None])


def expand_to_nodes(model: ShellModel, omega: FloatArray, shapes: FloatArray) -> EigenModes:
    """Return modes of all nodes from ``shapes`` (t, r) of the free translations.

    Rotations follow from equilibrium of the inertial forces: K u = omega² M phi.
    """
    t = model.free_translations
    load = np.zeros((len(model.free_dofs), len(omega)))
    load[t] = model.free_mass_kg[t, None] * shapes * omega**2
    nodal = np.zeros((model.n_dofs, len(omega)))
    nodal[model.free_dofs] = model.factor.solve(load)
    nodal[model.free_dofs[t]] = shapes
    per_node = nodal.reshape(-1, 6, len(omega))
    return EigenModes(omega, np.ascontiguousarray(per_node[:, :3]), np.ascontiguousarray(per_node[:, 3:]))
