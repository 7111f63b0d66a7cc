"""What a simulation asks of the search for contacts; `candidate_search.CandidateSearch` answers it."""

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
    """Finds what gets a row at the start of a step, and what ends too deep without one."""

    @property
    def has_candidates(self) -> bool:
        """Whether anything is so near that it may touch within a step."""

    @property
    def reach_m(self) -> float:
        """How far a piece may move in a step and be seen."""

    @property
    def dropped(self) -> int:
        """Candidates that found no room since the start."""

    def expect(self, moved_m: float) -> None:
        """Look as far as something may move in the next step."""

    def begin(self, bodies: Moving, geometry: Address[ContactGeometry]) -> None:
        """Place wall and pieces at the start of a step, and choose the candidates that get rows."""

    def restore_start(self) -> None:
        """Restore the start of the last step: bodies are where they were then."""

    def tool_pairs(self, catheter: CatheterBody, tools: ToolBody, pairs: ContactPairs) -> None:
        """Append the chosen candidates of the tools, and what of them touches the catheter."""

    def engage(self, pairs: ContactPairs, geometry: Address[ContactGeometry]) -> None:
        """Let tools that wait touch, unless a candidate or one of the pairs with the catheter shows them in it."""

    def catheter_pairs(self, pairs: ContactPairs) -> None:
        """Append the chosen candidates of catheter and spheres."""

    def follow_spheres(self, spheres: Spheres) -> None:
        """Find contacts of spheres with the wall too; again once there are more of them."""

    def see_ahead(self, gap_m: float) -> None:
        """Give the catheter rows from this gap on, which other laws than contact act across."""

    def price(self, bodies: Moving, state: Address[ContactState], tolerance_m: float, pairs: ContactPairs) -> int:
        """Write pairs of what ends too deep in the solved step, where the bodies are now, and return how many."""

    def price_tools(self, state: Address[ContactState], tolerance_m: float, pairs: ContactPairs) -> int:
        """Append pairs of tools that end too deep in the catheter where `price` has measured; return how many."""

    def note_pressed(self, state: Address[ContactState]) -> None:
        """Renew the life of what pressed in the step that was solved."""

    def forget(self) -> None:
        """Forget the working set: bodies have been put elsewhere."""

    def is_sound(self) -> bool:
        """Return whether the catheter's axis was clear of the wall's middle surface when the step began."""
