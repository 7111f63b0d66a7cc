"""Viscoelastic walls: a Prony series on every mode, with a recursion that is exact and never feeds energy in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel


@dataclass(frozen=True, slots=True)
class PronySeries:
    """Relaxation E(t) = E0 (1 - sum_k g_k (1 - exp(-t / tau_k))) of the instantaneous modulus E0.

    Attributes:
        g: tuple of float. Share of E0 that relaxes in each term, > 0, their sum below 1. The long-term modulus is E0 (1
            - sum g).
        tau_s: tuple of float. Relaxation times in s, > 0.
    """

    g: tuple[float, ...]
    tau_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.g) != len(self.tau_s):
            raise ValueError(f"Prony series: {len(self.g)} shares do not fit {len(self.tau_s)} times")
        if not all(share > 0.0 for share in self.g) or sum(self.g) >= 1.0:
            raise ValueError(f"Prony series: shares must be positive and sum to less than 1, not {self.g}")
        if not all(time > 0.0 for time in self.tau_s):
            raise ValueError(f"Prony series: relaxation times must be positive, not {self.tau_s}")

    def relaxation(self, t_s: FloatArray) -> FloatArray:
        """Return E(t) / E0."""
        left = np.ones_like(t_s)
        for share, time in zip(self.g, self.tau_s, strict=True):
            left -= share * (1.0 - np.exp(-t_s / time))
        return left


NEVER = PronySeries((), ())
"""Of a wall that does not relax."""


class ViscousModes:
    """The lagging coordinates d_k of every mode: omega^2 sum_k g_k d_k is what the wall has relaxed.

    Each tick: `add_force` to what drives the modes, step them (with the stiffness of the instantaneous modulus),
    then `relax`. The exact oscillator, undamped and with this force held, conserves
    q'^2 / 2 + omega^2 ((1 - sum g) q^2 + sum_k g_k (q - d_k)^2) / 2, and the relaxation, exact for the q it ends
    with, only lowers it: the splitting is dissipative at any step, first order in dt / tau. With Newmark the same
    holds where the acceleration at the start of a step counts the force of that step. The lag that a step takes is then
    that of its middle: a sine is answered in phase, with the loss modulus too high by coth(dt / 2 tau) dt / 2 tau.

    Attributes:
        series: PronySeries
        stiffness: (r,) float64. Of the modes, at once.
        g: (k,) float64. Shares of the terms.
        decay: (k,) float64. What is left of a lag at the end of the step.
        long_term: float. Share that never relaxes, 1 - sum g.
        d: (k, r) float64. Lagging coordinates; d' = (q - d) / tau.
        dissipated_j: float. Energy lost to relaxation so far.
    """

    def __init__(self, omega_rad_s: FloatArray, series: PronySeries) -> None:
        self.stiffness: FloatArray = omega_rad_s**2
        self.series = series
        self.g: FloatArray = np.array(series.g)
        self.long_term = 1.0 - float(self.g.sum())
        self._tau_s = np.array(series.tau_s)
        self._dt_s = float("nan")
        self.decay: FloatArray = np.ones(self.g.size)
        self.d: FloatArray = np.zeros((self.g.size, omega_rad_s.size))
        self.dissipated_j = 0.0

    def add_force(self, out: FloatArray) -> None:
        """Add omega^2 sum_k g_k d_k to the modal force ``out`` (r,)."""
        add_viscous_force(self.stiffness, self.g, self.d, out)

    def force(self) -> FloatArray:
        """Return omega^2 sum_k g_k d_k (r,)."""
        force: FloatArray = self.stiffness * (self.g @ self.d)
        return force

    def relax(self, q: FloatArray, dt_s: float) -> None:
        """Let the lagging coordinates follow q (r,) for ``dt_s``."""
        self.begin_step(dt_s)
        self.dissipated_j += relax_coordinates(self.stiffness, self.g, self.decay, q, self.d)

    def begin_step(self, dt_s: float) -> None:
        """Prepare ``decay`` for the end of a step of this length."""
        if dt_s != self._dt_s:
            self.decay[:] = np.exp(-dt_s / self._tau_s)
            self._dt_s = dt_s

    def stored_energy_j(self, q: FloatArray) -> float:
        """Return the elastic energy of a viscoelastic wall at q (r,): springs of all terms and the long-term one."""
        long_term = self.long_term * q**2
        terms = np.sum(self.g[:, None] * (q - self.d) ** 2, axis=0)
        return 0.5 * float(self.stiffness @ (long_term + terms))


@kernel
def add_viscous_force(stiffness: FloatArray, g: FloatArray, d: FloatArray, out: FloatArray) -> None:
    """Add stiffness sum_k g_k d_k to ``out`` (r,)."""
    for k in range(g.shape[0]):
        for mode in range(out.shape[0]):
            out[mode] += stiffness[mode] * g[k] * d[k, mode]


@kernel
def relax_coordinates(stiffness: FloatArray, g: FloatArray, decay: FloatArray, q: FloatArray, d: FloatArray) -> float:
    """Move d (k, r) towards q (r,) in place by the factor ``decay`` (k,) and return the energy lost, >= 0."""
    lost = 0.0
    for k in range(g.shape[0]):
        for mode in range(q.shape[0]):
            gap = q[mode] - d[k, mode]
            lost += 0.5 * stiffness[mode] * g[k] * gap * gap * (1.0 - decay[k] * decay[k])
        follow(d[k], q, decay[k])
    return lost


@kernel
def follow(lag: FloatArray, force: FloatArray, decay: float) -> None:
    """Let what lags follow a force, or what is in proportion to it, in place: exactly where that stays for the step.

    That is the one rule of all that relaxes: modes, the terms of the wall, and loads on what modes leave out.
    """
    for i in range(lag.shape[0]):
        lag[i] = force[i] - decay * (force[i] - lag[i])
