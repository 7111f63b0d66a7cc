"""The terms of a duct's wall beyond its linear modes, and the step that they take together."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import AnyArray
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples
from trocar.services.mechanics.reduction.modal_state import ModalState
from trocar.services.mechanics.reduction.nonlinear.cubic_force import CubicForce
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries
from trocar.services.mechanics.reduction.wall_step.energy_tank import CREDIT_J, MOST_OWED, settle_step
from trocar.services.mechanics.reduction.wall_step.implicit_step import (
    ENERGY,
    TANK,
    WallStep,
    held_force,
    relax_wall,
    wall_energy,
)
from trocar.services.mechanics.reduction.wall_step.polynomial_membrane import polynomial_energy
from trocar.services.mechanics.reduction.wall_step.sampled_membrane import membrane_energy

FADE_S = 0.25
"""Time in which all of a term fades out or in; the same as that of the softening wall."""
HOLD, SETTLE, RELAX = range(3)
"""Stages of a step."""


class WallTerms:
    """Terms that effects bring, and their one step.

    Effects with a term take turns in its stages, `hold`, `settle` and `relax`: in each step the first that `enters` one
    acts, for all. So any of them may rest.

    Attributes:
        samples, polynomial: the terms, None where there is none; taken on before the first step.
        series: PronySeries. How the wall relaxes: all of its terms alike.
        to_fade: float. Part of the sampled membrane that is to fade out.
        is_kept: bool. Whether an effect tells `state_arrays` already.
    """

    def __init__(self, duct: DuctBody) -> None:
        self._duct, n_modes = duct, duct.reduced.basis.n_modes
        self.samples: StretchSamples | None = None
        self.polynomial: CubicForce | None = None
        self.series: PronySeries = NEVER
        self._step: WallStep | None = None
        self._ahead = ModalState.at_rest(n_modes)
        self._force, self._held = np.zeros((2, n_modes))
        self._dt_s, self._stage = 0.0, RELAX
        self.to_fade, self.is_kept = 0.0, False

    @property
    def step(self) -> WallStep:
        """The terms' arrays."""
        if self._step is None:
            n_modes = self._duct.reduced.basis.n_modes
            self._step = WallStep.of(n_modes, self.samples, self.polynomial, self.series)
            self._step.books[ENERGY] = self.energy_j()
        return self._step

    def enters(self, stage: int) -> bool:
        """Enter a stage; False where another effect has entered it already."""
        is_first, self._stage = stage != self._stage, stage
        return is_first

    def hold(self, dt_s: float) -> None:
        """Hold the mean force of the step that begins: call it when all other loads on the modes are there."""
        duct, ahead, step = self._duct, self._ahead, self.step
        if dt_s != self._dt_s:
            step.take_gain(duct.held_gain)
            self._dt_s = dt_s
        ahead.q[:], ahead.qdot[:] = duct.state.q, duct.state.qdot
        np.subtract(duct.state.qddot, self._held, out=ahead.qddot)
        duct.integrator.predict(ahead, duct.modal_force, dt_s)
        ahead.q += duct.position_gain * duct.contact_impulse
        held_force(step.address, duct.state.q, ahead.q, self._force)
        duct.hold(self._held, self._force)

    def settle(self, clearance_m: float, dt_s: float) -> float:
        """Correct a step in which contacts changed, see `settle_step`; return what the step has lost, in J."""
        lost_j = settle_step(self.step, self._held, self._duct, clearance_m)
        faded = self.step.membrane.faded
        if faded[0] != self.to_fade:
            most, before_j = dt_s / FADE_S, self.step.books[ENERGY]
            faded[0] += min(max(self.to_fade - faded[0], -most), most)
            self.step.books[ENERGY] = self.energy_j()
            lost_j += before_j - self.step.books[ENERGY]
        return lost_j

    def relax(self, dt_s: float) -> float:
        """Let the terms relax for ``dt_s``, if the wall does; return the energy lost in J."""
        if not self.series.g:
            return 0.0
        decay = np.exp(-dt_s / np.array(self.series.tau_s))
        return float(relax_wall(self.step.address, self._duct.state.q, decay))

    @property
    def is_settled(self) -> bool:
        """Whether the step owes no more energy than `MOST_OWED` of what is stored."""
        books = self.step.books
        return bool(books[TANK] >= -CREDIT_J - MOST_OWED * abs(books[ENERGY]))

    def energy_j(self) -> float:
        """Return the energy of all terms."""
        return float(wall_energy(self.step.address, self._duct.state.q))

    def membrane_energy_j(self) -> float:
        """Return the energy of the sampled membrane."""
        return float(membrane_energy(self.step.membrane, self._duct.state.q))

    def polynomial_energy_j(self) -> float:
        """Return the energy of the polynomial."""
        return float(polynomial_energy(self.step.polynomial, self._duct.state.q))

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        return self._held, *self.step.state_arrays()


def terms_of(duct: DuctBody) -> WallTerms:
    """Return the terms of a duct, which has none at first."""
    if duct.terms is None:
        duct.terms = WallTerms(duct)
    terms: WallTerms = duct.terms
    return terms
