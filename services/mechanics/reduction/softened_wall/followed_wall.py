"""A wall that softens, stepped with the duct: what it pushes on the modes, and its energies."""

from __future__ import annotations

from services.mechanics.arrays import AnyArray, FloatArray, IntArray
from services.mechanics.reduction.duct import ReducedDuct
from services.mechanics.reduction.softened_wall.follow import follow_loads
from services.mechanics.reduction.softened_wall.wall import SPENT, STORED, SoftenedWall
from services.mechanics.reduction.softening.training import WallSoftening
from services.mechanics.reduction.state import ModalIntegrator


class FollowedWall:
    """The arguments are those of `SoftenedWall.of`.

    Attributes
    ----------
    force : (r,) float64
        What acts on the modes in the next step.
    """

    def __init__(
        self,
        duct: ReducedDuct,
        softening: WallSoftening,
        constant_modal_force: FloatArray,
        integrator: ModalIntegrator,
        lasting: float,
    ) -> None:
        self._wall = SoftenedWall.of(duct, softening, constant_modal_force, integrator, lasting)
        self.force = self._wall.force

    @property
    def stored_j(self) -> float:
        """What the wall stores less than a linear one that is displaced as far."""
        return float(self._wall.books[STORED])

    @property
    def dissipated_j(self) -> float:
        """What changes of the pattern have taken out so far."""
        return float(self._wall.books[SPENT])

    def follow(
        self,
        loads: tuple[IntArray, FloatArray],
        modal_force: FloatArray,
        motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
        dt_s: float,
    ) -> None:
        """Follow the contact forces, and the wall, see `follow_loads`."""
        follow_loads(self._wall.address, loads, modal_force, motion, dt_s)

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        return self._wall.state_arrays()
