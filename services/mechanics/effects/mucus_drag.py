"""Viscous drag of the mucus film between catheter and wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from services.mechanics.arrays import FloatArray
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

    The area is a segment's length times its diameter. Solved with the contacts, as rows that hold the tangents with
    the compliance dt / b: implicit, so that any viscosity is stable; equal and opposite on catheter and wall. A
    particle has one area however many facets it is near: in a fold, its rows share b.
    """

    Settings = MucusDragSettings

    def prepare(self, world: World) -> None:
        """Work out b."""
        catheter = world.catheter
        area = catheter.properties.segment_length_m * 2.0 * catheter.radius_m
        self._b_n_s_m = self.settings.viscosity_pa_s * area / self.settings.film_m
        self._weight = np.zeros(catheter.start_m.shape[0])

    def add_rows(self, world: World, dt_s: float) -> None:
        """Double the rows of the catheter on the wall by a film."""
        append_films(world.system.rows.address, self._weight, dt_s / self._b_n_s_m)


@kernel
def append_films(rows_address: Address[ContactRows], weight: FloatArray, softness: float) -> None:
    """Append a film to each row of the catheter against the wall; ``softness`` is dt / b of one particle.

    A row takes of each of its particles that part of b which its weight is of the weights of all the particle's rows,
    summed up in ``weight`` (n,). A point between two particles that no other row sees has b once.
    """
    rows = rows_at(rows_address)
    n_sources = rows.n_contacts
    weight[:] = 0.0
    for source in range(n_sources):
        if _is_catheter_on_wall(rows, source):
            for end in range(2):
                weight[rows.rod_node[source, end]] += rows.rod_weight[source, end]
    for source in range(n_sources):
        if not _is_catheter_on_wall(rows, source):
            continue
        share = 0.0
        for end in range(2):
            share += rows.rod_weight[source, end] / max(weight[rows.rod_node[source, end]], 1.0)
        row = append_double(rows, source, _FILM)
        if row != NO_ROOM:
            rows.softness_m_n[row, 1] = rows.softness_m_n[row, 2] = softness / share


@kernel
def _is_catheter_on_wall(rows: ContactRows, row: int) -> bool:
    on_wall = rows.duct_weight[row, 0] + rows.duct_weight[row, 1] + rows.duct_weight[row, 2] > 0.0
    return bool(on_wall and rows.tool[row] == NO_TOOL and rows.stone[row] == NO_STONE)
