"""Viscous drag of the mucus film between catheter and wall."""

from __future__ import annotations

from dataclasses import dataclass

from services.mechanics.collision.pairs import NO_TOOL
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.laws import number_of
from services.mechanics.contact.rows import NO_STONE, ContactRows, rows_at
from services.mechanics.contact.writer import NO_ROOM, append_double
from services.mechanics.effects.base import Effect, require_positive
from services.mechanics.world import World

_FILM = number_of("film")


@dataclass(frozen=True, slots=True)
class MucusDragSettings:
    """Viscosity of the film at the rates of an insertion, and its thickness, which is also its reach; assumptions."""

    viscosity_pa_s: float = 0.5
    film_m: float = 0.3e-3

    def __post_init__(self) -> None:
        require_positive(self, "viscosity_pa_s", "film_m")


class MucusDrag(Effect):
    """Couette drag of each particle against the wall it is near: f = -b v with b = viscosity * area / film.

    The area is a segment's length times its diameter. Solved with the contacts, as a row that holds the tangents with
    the compliance dt / b: implicit, so that any viscosity is stable; equal and opposite on catheter and wall.
    """

    Settings = MucusDragSettings

    def prepare(self, world: World) -> None:
        """Work out b."""
        catheter = world.catheter
        area = catheter.properties.segment_length_m * 2.0 * catheter.radius_m
        self._b_n_s_m = self.settings.viscosity_pa_s * area / self.settings.film_m

    def add_rows(self, world: World, dt_s: float) -> None:
        """Double the rows of the catheter on the wall by a film."""
        append_films(world.system.rows.address, dt_s / self._b_n_s_m)


@kernel
def append_films(rows_address: Address[ContactRows], softness: float) -> None:
    """Append one film per present row of a particle against the wall; ``softness`` is dt / b."""
    rows = rows_at(rows_address)
    for source in range(rows.n_contacts):
        on_wall = rows.duct_weight[source, 0] + rows.duct_weight[source, 1] + rows.duct_weight[source, 2] > 0.0
        if rows.tool[source] != NO_TOOL or not on_wall or rows.stone[source] != NO_STONE:
            continue
        row = append_double(rows, source, _FILM)
        if row != NO_ROOM:
            rows.softness_m_n[row, 1] = rows.softness_m_n[row, 2] = softness
