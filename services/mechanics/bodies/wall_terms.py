"""The terms of a duct's wall beyond its linear modes, and the step that they take together."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import AnyArray
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples
from trocar.services.mechanics.reduction.modal_state import ModalState
from trocar.services.mechanics.reduction.nonlinear.cubic_force import CubicForce
from trocar.services.mechanics.reduction.softened_wall.load_pattern import GAIN
from trocar.services.mechanics.reduction.softened_wall.pattern_change import change_pattern
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SoftenedWall
from trocar.services.mechanics.reduction.viscoelastic import NEVER
from trocar.services.mechanics.reduction.wall_step.energy_tank import MOST_OWED, settle_step
from trocar.services.mechanics.reduction.wall_step.implicit_step import (
    CREDIT_J,
    ENERGY,
    LAGGED,
    TANK,
    WallStep,
    acting_share,
    held_force,
    relax_wall,
    replace_terms,
    wall_energy,
)
from trocar.services.mechanics.reduction.wall_step.lagging_energy import conjugate_energy

FADE_S = 0.25
"""Time in which all of a term fades out or in: the change that a hand feels, newtons, then stays far below a rig's
limit on the rate of forces."""
_HOLD, _SETTLE, _END = range(3)
"""Stages of a step."""


class WallTerms:
    """Terms that effects bring, and their one step.

    Effects with a term take turns in its stages, `hold`, `settle` and `end_step`: in each step the first that calls one
    acts, for all. So any of them may rest.

    Attributes:
        samples, polynomial, softened: what the terms are made of, None where there is none; taken on before the first
            step.
        to_fade: dict. Part of a term that is to fade out: of the sampled membrane, and of the pattern.
        is_kept: bool. Whether an effect tells `state_arrays` already.
        lost_j: float. Energy that steps have lost so far, and changes of terms.
    """

    def __init__(self, duct: DuctBody) -> None:
        self._duct, n_modes = duct, duct.reduced.basis.n_modes
        self.samples: StretchSamples | None = None
        self.polynomial: CubicForce | None = None
        self.softened: SoftenedWall | None = None
        self._step: WallStep | None = None
        self._ahead = ModalState.at_rest(n_modes)
        self._force, self._held, self._held_lagging = np.zeros((3, n_modes))
        self._no_lag, self._stiffness = np.zeros((0, n_modes)), duct.reduced.basis.omega_rad_s**2
        self._dt_s, self._stage, self._decay = 0.0, _END, (0.0, np.zeros(0))
        self.to_fade = {"membrane": 0.0, "pattern": 0.0}
        self.is_kept, self.lost_j = False, 0.0

    @property
    def step(self) -> WallStep:
        """The terms' arrays."""
        if self._step is None:
            series = NEVER if self._duct.viscous is None else self._duct.viscous.series
            pattern = None if self.softened is None else self.softened.new_pattern()
            self._step = WallStep.of(self._stiffness, self.samples, self.polynomial, series, pattern)
            self._step.rest[:] = self._duct.constant_modal_force / self._stiffness
            self._step.books[ENERGY] = self.energy_j()
            self._step.books[LAGGED] = -self._lagging_j()
        return self._step

    def _enters(self, stage: int) -> bool:
        """Enter a stage; False where another effect has entered it already."""
        is_first, self._stage = stage != self._stage, stage
        return is_first

    def hold(self, dt_s: float) -> None:
        """Hold the mean force of the step that begins: call it when all other loads on the modes are there."""
        duct, ahead, step = self._duct, self._ahead, self.step
        if dt_s != self._dt_s:
            step.take_gain(duct.held_gain)
            self._dt_s = dt_s
        if not self._enters(_HOLD) or (step.rests and not self._held.any()):
            return
        duct.hold(self._held_lagging, step.lagging)
        ahead.q[:], ahead.qdot[:] = duct.state.q, duct.state.qdot
        np.subtract(duct.state.qddot, self._held, out=ahead.qddot)
        duct.integrator.predict(ahead, duct.modal_force, dt_s)
        ahead.q += duct.position_gain * duct.contact_impulse
        held_force(step.address, duct.state.q, ahead.q, self._force)
        duct.hold(self._held, self._force)

    def settle(self, clearance_m: float, dt_s: float) -> None:
        """Correct a step in which contacts changed, see `settle_step`, and let terms fade."""
        if self._enters(_SETTLE):
            step = self.step
            self.lost_j += 0.0 if step.rests else settle_step(step, self._held, self._duct, clearance_m)
            self.lost_j += self._fade(dt_s)

    def end_step(self, dt_s: float) -> None:
        """Let the terms relax, if the wall does, and the pattern follow the contact forces."""
        if self._enters(_END):
            duct, step = self._duct, self.step
            if duct.viscous is not None and not (step.rests and not step.lag.any()):
                if dt_s != self._decay[0]:
                    self._decay = dt_s, np.exp(-dt_s / np.array(duct.viscous.series.tau_s))
                relax_wall(step.address, duct.q_start, duct.state.q, self._decay[1])
            self.lost_j += self._follow_contacts(dt_s)

    def _fade(self, dt_s: float) -> float:
        """Fade terms out or in; return the energy lost. A pattern that is gone is out of date when it comes back."""
        step, most, has_changed = self.step, dt_s / FADE_S, False
        for name, term in (("membrane", step.membrane), ("pattern", step.pattern)):
            faded, to = term.faded, self.to_fade[name]
            if faded[0] != to:
                faded[0] += min(max(to - faded[0], -most), most)
                has_changed = True
        if not has_changed:
            return 0.0
        if step.pattern.faded[0] == 1.0:
            step.pattern.numbers[GAIN] = 0.0
        before_j = float(step.books[ENERGY])
        replace_terms(step.address, self._duct.state.q)
        return before_j - float(step.books[ENERGY])

    def _follow_contacts(self, dt_s: float) -> float:
        """Let the pattern follow the contact forces; return the energy lost thereby."""
        duct, softened = self._duct, self.softened
        if softened is None or self.step.pattern.faded[0] == 1.0:
            return 0.0
        n = duct.n_contact_loads
        nodes = duct.load_nodes[:n]
        loads = nodes, duct.turn_to_wall(nodes, duct.load_force_n[:n])
        lagging = duct.state.q, self._no_lag if duct.viscous is None else duct.viscous.d
        addresses = softened.address, self.step.address
        return float(change_pattern(*addresses, loads, duct.contact_impulse, lagging, dt_s))

    @property
    def is_settled(self) -> bool:
        """Whether the step owes no more energy than `MOST_OWED` of what is stored."""
        books = self.step.books
        return bool(books[TANK] >= -CREDIT_J - MOST_OWED * abs(books[ENERGY]))

    def energy_j(self) -> float:
        """Return the energy of all terms, with what lags; too slow for every tick where the wall relaxes."""
        return float(wall_energy(self.step.address, self._duct.state.q)) + self._lagging_j()

    @property
    def dissipated_j(self) -> float:
        """Energy lost so far; what lags has lost the work that was done on it, less what it stores."""
        return self.lost_j - float(self.step.books[LAGGED]) - self._lagging_j()

    def _lagging_j(self) -> float:
        """Return the energy of what lags, less that of a linear wall; see `relax_wall`."""
        viscous, step = self._duct.viscous, self.step
        if viscous is None or not viscous.d.any():
            return 0.0
        total, q = 0.0, self._duct.state.q
        for g, d, lag in zip(viscous.g, viscous.d, step.lag, strict=True):
            largest = conjugate_energy(step, self._stiffness * d + lag, q)
            total += g * (largest - float(lag @ q) - 0.5 * float(self._stiffness @ d**2))
        return float(acting_share(step)) * total

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        of_forces = () if self.softened is None else self.softened.state_arrays()
        return self._held, self._held_lagging, *self.step.state_arrays(), *of_forces


def terms_of(duct: DuctBody) -> WallTerms:
    """Return the terms of a duct, which has none at first."""
    if duct.terms is None:
        duct.terms = WallTerms(duct)
    terms: WallTerms = duct.terms
    return terms
