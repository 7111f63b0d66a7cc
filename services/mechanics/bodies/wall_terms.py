"""The terms of a duct's wall beyond its linear modes, and the step that they take together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.bodies.duct_loads import DuctLoads, DuctMotion, hold_force, loads_at
from trocar.services.mechanics.bodies.wall_end import EndingWall, LaggingModes, end_wall_step
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples
from trocar.services.mechanics.reduction.nonlinear.membrane_polynomial import MembranePolynomial
from trocar.services.mechanics.reduction.softened_wall.load_pattern import GAIN
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SoftenedWall
from trocar.services.mechanics.reduction.viscoelastic import NEVER, ViscousModes, add_viscous_force
from trocar.services.mechanics.reduction.wall_step.energy_tank import MOST_OWED, settle_step
from trocar.services.mechanics.reduction.wall_step.implicit_step import (
    CREDIT_J,
    ENERGY,
    LAGGED,
    TANK,
    WallStep,
    acting_share,
    energy_and_loss,
    held_force,
    pushes,
    replace_terms,
    wall_at,
    wall_energy,
)
from trocar.services.mechanics.reduction.wall_step.lagging_energy import conjugate_energy

FADE_S = 0.25
"""Time in which all of a term fades out or in: the change that a hand feels, newtons, then stays far below a rig's
limit on the rate of forces."""


class WallTerms:
    """Terms that effects bring, and their one step, with the relaxation of the wall.

    In each step they are called once, whatever effects there are: first `hold_relaxed` and `hold`, then `settle`, last
    `end_step`.

    Attributes:
        samples, polynomial, softened: what the terms are made of, None where there is none; taken on before the first
            step.
        is_kept: bool. Whether an effect tells `state_arrays` already.
        lost_j: float. Energy that steps have lost so far, and changes of terms.
        held_relaxed: (r,) float64. What `hold_relaxed` held last: state of the effect that calls it.
    """

    def __init__(self, duct: DuctBody) -> None:
        self._duct, n_modes = duct, duct.reduced.basis.n_modes
        self.samples: StretchSamples | None = None
        self.polynomial: MembranePolynomial | None = None
        self.softened: SoftenedWall | None = None
        self._step: WallStep | None = None
        self._held, self._held_lagging = np.zeros((2, n_modes))
        self._scratch, self._acts = np.zeros((2, n_modes)), False
        self._stiffness = duct.reduced.basis.omega_rad_s**2
        self._own_n, self.held_relaxed = np.zeros_like(duct.load_force_n), np.zeros(n_modes)
        self._ending: tuple[EndingWall, LaggingModes] | None = None
        self._gain_dt_s = np.zeros(1)  # of the step whose gain is in the terms' rows: it goes back with them
        self._to_fade, self._is_fading = {"membrane": 0.0, "pattern": 0.0}, False
        self.is_kept, self.lost_j = False, 0.0
        self._begun_j = 0.0  # what the tank held when the step began
        self._lagging_of = b"", 0.0  # the last state that it was found of, and what was found

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

    def hold(self, dt_s: float) -> None:
        """Hold the mean force of the step that begins: call it when all other loads on the modes are there."""
        duct, step = self._duct, self.step
        self._begun_j = float(step.books[TANK])
        if dt_s != self._gain_dt_s[0]:
            step.take_gain(duct.held_gain)
            self._gain_dt_s[0] = dt_s
        self._acts = hold_terms(
            step.address, duct.loads_address, duct.free_end_parts, (self._held_lagging, self._held), self._scratch
        )

    def settle(self, clearance_m: Callable[[], float], dt_s: float) -> None:
        """Correct a step in which contacts changed, see `settle_step`, and let terms fade."""
        if self._acts:
            self.lost_j += settle_step(self.step, self._held, self._duct, clearance_m)
        if self._is_fading:
            self.lost_j += self._fade(dt_s)

    def hold_relaxed(self) -> None:
        """Hold what the linear modes have relaxed over the step that begins."""
        viscous = self._duct.viscous
        if viscous is not None:
            modes = viscous.stiffness, viscous.g, viscous.d
            hold_relaxed(self._duct.motion_address, modes, self.held_relaxed, self._scratch[0])

    def end_step(self, dt_s: float) -> None:
        """Let all that lags follow, if the wall relaxes, and the pattern follow the contact forces."""
        duct, loads = self._duct, self._duct.viscous_loads
        if self._ending is None:
            self._ending = self._find_ending()
        if duct.viscous is not None:
            duct.viscous.begin_step(dt_s)
        if loads is not None:
            loads.begin_step(dt_s)
        lost_j, relaxed_j = end_wall_step(*self._ending, self._own_n, self._acts, dt_s)
        self.lost_j += lost_j
        if duct.viscous is not None:
            duct.viscous.dissipated_j += relaxed_j

    def _find_ending(self) -> tuple[EndingWall, LaggingModes]:
        duct, softened, loads = self._duct, self.softened, self._duct.viscous_loads
        viscous = ViscousModes(duct.reduced.basis.omega_rad_s, NEVER) if duct.viscous is None else duct.viscous
        of_softening = Address(0) if softened is None else softened.address
        of_loads = Address(0) if loads is None else loads.address
        addresses: EndingWall = duct.loads_address, duct.sections, self.step.address, of_softening, of_loads
        return addresses, (viscous.stiffness, viscous.g, viscous.decay, viscous.d)

    def fade(self, term: Literal["membrane", "pattern"], part: float) -> None:
        """Begin to fade a term until this part of it is gone."""
        self._to_fade[term], self._is_fading = part, True

    def _fade(self, dt_s: float) -> float:
        """Fade terms out or in; return the energy lost. A pattern that is gone is out of date when it comes back."""
        step, most, has_changed = self.step, dt_s / FADE_S, False
        for name, term in (("membrane", step.membrane), ("pattern", step.pattern)):
            faded, to = term.faded, self._to_fade[name]
            if faded[0] != to:
                faded[0] += min(max(to - faded[0], -most), most)
                has_changed = True
        self._is_fading = has_changed
        if not has_changed:
            return 0.0
        if step.pattern.faded[0] == 1.0:
            step.pattern.numbers[GAIN] = 0.0
        before_j = float(step.books[ENERGY])
        replace_terms(step.address, self._duct.state.q)
        return before_j - float(step.books[ENERGY])

    def compile_rare_kernels(self) -> None:
        """Compile the kernels of a step that is corrected, and of terms that fade; no step may follow."""
        address, q = self.step.address, self._duct.state.q
        held_force(address, q, q, self._held.copy())
        energy_and_loss(address, self._held, q, q)
        replace_terms(address, q)

    @property
    def is_settled(self) -> bool:
        """Whether the step owes no more energy than `MOST_OWED` of what is stored, or than it began with.

        What is stored may fall below a debt that was small once: a wall that comes to rest must not stand still for it.
        """
        books = self.step.books
        return bool(books[TANK] >= min(-CREDIT_J - MOST_OWED * abs(books[ENERGY]), self._begun_j))

    def energy_j(self) -> float:
        """Return the energy of all terms, with what lags; too slow for every tick where the wall relaxes."""
        return float(wall_energy(self.step.address, self._duct.state.q)) + self._lagging_j()

    @property
    def dissipated_j(self) -> float:
        """Energy lost so far; what lags has lost the work that was done on it, less what it stores."""
        return self.lost_j - float(self.step.books[LAGGED]) - self._lagging_j()

    def _lagging_j(self) -> float:
        """Return the energy of what lags, less that of a linear wall; see `relax_wall`.

        A book asks for it several times in one state, in what is stored and in what is lost: it is found once.
        """
        viscous = self._duct.viscous
        if viscous is None or not viscous.d.any():
            return 0.0
        arrays = self._duct.state.q, viscous.d, *self.state_arrays()
        state = b"".join(array.tobytes() for array in arrays)
        if state != self._lagging_of[0]:
            self._lagging_of = state, self._find_lagging_j(viscous)
        return self._lagging_of[1]

    def _find_lagging_j(self, viscous: ViscousModes) -> float:
        step, total, q = self.step, 0.0, self._duct.state.q
        for g, d, lag in zip(viscous.g, viscous.d, step.lag, strict=True):
            largest = conjugate_energy(step, self._stiffness * d + lag, d)
            total += g * (largest - float(lag @ q) - 0.5 * float(self._stiffness @ d**2))
        return float(acting_share(step)) * total

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        of_forces = () if self.softened is None else self.softened.state_arrays()
        return self._held, self._held_lagging, self._gain_dt_s, *self.step.state_arrays(), *of_forces


def terms_of(duct: DuctBody) -> WallTerms:
    """Return the terms of a duct, which has none at first."""
    if duct.terms is None:
        duct.terms = WallTerms(duct)
    terms: WallTerms = duct.terms
    return terms


@kernel
def hold_relaxed(
    address: Address[DuctMotion], modes: tuple[FloatArray, FloatArray, FloatArray], held: FloatArray, force: FloatArray
) -> None:
    """Hold what modes have relaxed; ``modes`` are stiffness (r,), shares (t,) and the coordinates that lag (t, r).

    ``held`` (r,) is that of the last step, which is overwritten; ``force`` (r,) is scratch.
    """
    for mode in range(force.shape[0]):
        force[mode] = 0.0
    add_viscous_force(*modes, force)
    hold_force(address, held, force)


@kernel
def hold_terms(
    address: Address[WallStep],
    loads_address: Address[DuctLoads],
    free_end_parts: FloatArray,
    held: tuple[FloatArray, FloatArray],
    scratch: FloatArray,
) -> bool:
    """Hold the force of what lags and the mean force of the terms; False where the wall has none.

    ``held`` are those of the last step, which are overwritten; see `DuctBody.hold` and `DuctBody.free_end_parts`.
    """
    wall, loads, of_lag, of_terms = wall_at(address), loads_at(loads_address), held[0], held[1]
    duct, end, force = loads.free, scratch[0], scratch[1]
    if not pushes(wall, of_terms):
        return False
    for mode in range(end.shape[0]):
        change = wall.lagging[mode] - of_lag[mode]
        duct.qddot[mode] += change
        duct.held[mode] += change
        of_lag[mode] = wall.lagging[mode]
        duct.force[mode] += of_lag[mode]
        begun = free_end_parts[0, mode] * duct.q[mode] + free_end_parts[1, mode] * duct.qdot[mode]
        begun += free_end_parts[2, mode] * (duct.qddot[mode] - of_terms[mode])
        end[mode] = begun + free_end_parts[3, mode] * duct.force[mode] + loads.gains[0, mode] * loads.impulse[mode]
    held_force(address, duct.q, end, force)
    for mode in range(end.shape[0]):
        change = force[mode] - of_terms[mode]
        duct.qddot[mode] += change
        duct.held[mode] += change
        duct.force[mode] += force[mode]
        of_terms[mode] = force[mode]
    return True
