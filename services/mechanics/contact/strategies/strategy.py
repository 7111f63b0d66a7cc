"""The base class of solve strategies."""

from __future__ import annotations

from typing import ClassVar

from services.mechanics.contact.geometry import Bodies
from services.mechanics.contact.state import ContactState
from services.mechanics.scene import ContactSettings


class ContactStrategy:
    """A method that finds the contact forces of a step.

    Attributes:
        acts_in_next_step: bool. Whether the forces act on the catheter over the next step instead of the present one.
        keeps_delassus: bool. Whether it assembles the Delassus operator W, from which the local stiffness follows.
    """

    acts_in_next_step: ClassVar[bool]
    keeps_delassus: ClassVar[bool]

    def __init__(self, bodies: Bodies, settings: ContactSettings, state: ContactState) -> None:
        self._bodies = bodies
        self._settings = settings
        self._state = state
        self._address = state.address

    def assemble(self) -> None:
        """Gather from the bodies what the solve needs at the contact points."""
        raise NotImplementedError

    def compile_kernels(self) -> None:
        """Compile kernels that steps rarely use; call it after a step with contacts. By default there are none."""

    def solve(self, iterations: int, dt_s: float) -> int:
        """Find the forces, in contact frames and along world axes, and the sliding states; return the number of sweeps.

        Args:
            iterations: int. Maximum number of sweeps, see `solver.solve_contacts`.
            dt_s: float. Length of the step.
        """
        raise NotImplementedError
