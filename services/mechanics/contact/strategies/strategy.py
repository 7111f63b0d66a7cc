"""The base class of solve strategies."""

from __future__ import annotations

from typing import ClassVar

from services.mechanics.contact.geometry import Bodies
from services.mechanics.contact.state import ContactState
from services.mechanics.scene import ContactSettings


class ContactStrategy:
    """A way to find the contact forces of a step.

    Attributes:
        acts_in_next_step: bool. Whether the catheter feels the forces in the next step, held over all of it, instead of
            in the one they were found in.
        knows_stiffness: bool. Whether it leaves W behind, from which the local stiffness follows.
    """

    acts_in_next_step: ClassVar[bool]
    knows_stiffness: ClassVar[bool]

    def __init__(self, bodies: Bodies, settings: ContactSettings, state: ContactState) -> None:
        self._bodies = bodies
        self._settings = settings
        self._state = state
        self._address = state.address

    def assemble(self) -> None:
        """Gather what the solve needs of the bodies at the contacts' points."""
        raise NotImplementedError

    def compile_kernels(self) -> None:
        """Compile the kernels that a step runs seldom, after a step with contacts; by default there are none."""

    def solve(self, iterations: int, dt_s: float) -> int:
        """Find forces, sliding states and world-axis forces; return the number of sweeps."""
        raise NotImplementedError
