"""Softening wall in a step of the duct: its force on the modes, and its energies."""

from __future__ import annotations

from trocar.services.mechanics.arrays import AnyArray, FloatArray, IntArray
from trocar.services.mechanics.reduction.modal_state import ModalIntegrator, ModalState
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SPENT, STORED, SoftenedWall
from trocar.services.mechanics.reduction.softened_wall.softening_force import follow_loads, push_ahead
from trocar.services.mechanics.reduction.softening.training import WallSoftening
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries


class SofteningStep:
    """A softening wall that is stepped with the duct; the arguments are those of `SoftenedWall.of`.

    Attributes:
        force: (r,) float64. Modal force of the next step.
    """

    def __init__(
        self,
        duct: ReducedDuct,
        softening: WallSoftening,
        constant_modal_force: FloatArray,
        integrator: ModalIntegrator,
        series: PronySeries = NEVER,
    ) -> None:
        self._wall = SoftenedWall.of(duct, softening, constant_modal_force, integrator, series)
        self._integrator = integrator
        self._ahead = ModalState.at_rest(duct.basis.n_modes)
        self.force = self._wall.force

    @property
    def has_faded(self) -> bool:
        """Whether no softening is left."""
        return float(self._wall.faded[0]) == 1.0

    def fade(self, part: float) -> None:
        """Fade the softening in the steps that follow until this part of it is gone; see `softening_force`."""
        self._wall.to_fade = part

    @property
    def stored_j(self) -> float:
        """What the wall stores less than a linear one that is displaced as far."""
        return float(self._wall.books[STORED])

    @property
    def dissipated_j(self) -> float:
        """Energy that changes of the pattern have dissipated so far, less the energy that relaxing softening stores."""
        return float(self._wall.books[SPENT])

    def follow(
        self,
        loads: tuple[IntArray, FloatArray],
        modal_force: FloatArray,
        drive: tuple[FloatArray, FloatArray],
        motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
        dt_s: float,
    ) -> None:
        """Follow the contact forces, and the wall, see `follow_loads` and `push_ahead`.

        ``drive`` is what drove the modes in the last step, ``force`` included (r,), and what contacts moved
        them by (r,): in the next step they are expected to do the same.
        """
        made, (driving, by_impulses) = self._integrator.gains(dt_s), drive
        others = driving - self.force
        gains = made.position, made.velocity, made.acceleration
        follow_loads(self._wall.address, loads, modal_force, motion, gains, dt_s)
        if self._wall.stiffens():
            ahead, (q, _, qdot, qddot) = self._ahead, motion
            ahead.q[:], ahead.qdot[:], ahead.qddot[:] = q, qdot, qddot
            self._integrator.predict(ahead, others + self.force, dt_s)
            ahead.q += by_impulses
            push_ahead(self._wall.address, q, ahead.q, made.position, qddot)

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        return self._wall.state_arrays()
