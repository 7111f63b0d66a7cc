"""The interface of contact detection; `candidate_search.CandidateSearch` implements it."""

from __future__ import annotations

from typing import Protocol

from services.mechanics.bodies.catheter import CatheterBody
from services.mechanics.bodies.duct import DuctBody
from services.mechanics.bodies.forceps.tool_body import ToolBody
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.geometry import ContactGeometry
from services.mechanics.contact.spheres import Spheres
from services.mechanics.contact.state import ContactState

Moving = tuple[DuctBody, CatheterBody, ToolBody]


class ContactSearch(Protocol):
    """Finds the pairs that get a row at the start of a step, and those that end too deep without one."""

    @property
    def has_candidates(self) -> bool:
        """Whether any pair is so near that it may come into contact within a step."""

    @property
    def reach_m(self) -> float:
        """Motion (m) of a piece in a step up to which its contacts are detected."""

    @property
    def dropped(self) -> int:
        """Candidates that exceeded the capacity since the start."""

    def expect(self, moved_m: float) -> None:
        """Set the look-ahead for a motion (m) in the next step."""

    def begin(self, bodies: Moving, geometry: Address[ContactGeometry]) -> None:
        """Place wall and pieces at the start of a step, and choose the candidates that get rows."""

    def restore_start(self) -> None:
        """Restore the start of the last step: bodies are where they were then."""

    def tool_pairs(self, catheter: CatheterBody, tools: ToolBody, pairs: ContactPairs) -> None:
        """Append the chosen candidates of the tools, and their pairs with the catheter."""

    def engage(self, pairs: ContactPairs, geometry: Address[ContactGeometry]) -> None:
        """Engage disengaged tools, unless a candidate or one of ``pairs`` shows that they overlap a body."""

    def catheter_pairs(self, pairs: ContactPairs) -> None:
        """Append the chosen candidates of catheter and spheres."""

    def set_spheres(self, spheres: Spheres) -> None:
        """Find contacts of spheres with the wall too; again once there are more of them."""

    def set_catheter_row_gap(self, gap_m: float) -> None:
        """Give the catheter rows from this gap (m) on, for laws that act across a gap."""

    def price(self, bodies: Moving, state: Address[ContactState], tolerance_m: float, pairs: ContactPairs) -> int:
        """Write pairs of the candidates that end the step too deep, at the present poses; return their number."""

    def price_tools(self, state: Address[ContactState], tolerance_m: float, pairs: ContactPairs) -> int:
        """Append pairs of tools and catheter that end too deep, at the poses of the last `price`; return how many."""

    def update_working_set(self, state: Address[ContactState]) -> None:
        """Renew the life of the features whose contacts carried a force in the solved step."""

    def forget(self) -> None:
        """Clear the working set, because bodies have been put elsewhere."""

    def is_sound(self) -> bool:
        """Return whether the catheter's axis was clear of the wall's middle surface when the step began."""
