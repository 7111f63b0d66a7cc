"""Viscous drag of the mucus film between catheter and wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.rows import NO_STONE, ContactRows, rows_at
from trocar.services.mechanics.contact.writer import NO_ROOM, append_copy
from trocar.services.mechanics.effects.base import Effect, require_positive
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.world import World

_FILM = number_of("film")


@dataclass(frozen=True, slots=True)
class MucusDragSettings:
    """Viscosity of the film at the rates of an insertion, and its thickness, which is also its reach; assumptions.

    The wet length is one of whole segments of the catheter, one for each particle that the film reaches.
    """

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
    can_rest = True

    def __init__(self, settings: MucusDragSettings, scene: SceneModel) -> None:
        super().__init__(settings, scene)
        if settings.film_m > scene.contact.margin_m:
            raise ValueError(
                f"effects.mucus_drag.film_m: {settings.film_m:g} m is more than contact.margin_m, "
                f"{scene.contact.margin_m:g} m, beyond which no wall is looked for"
            )

    def prepare(self, world: World) -> None:
        """Compute b, and extend the catheter's contact margin to the film's thickness."""
        world.search.set_catheter_row_gap(self.settings.film_m)
        catheter = world.catheter
        area = catheter.properties.segment_length_m * 2.0 * catheter.radius_m
        self._b_n_s_m = self.settings.viscosity_pa_s * area / self.settings.film_m
        self._weight = np.zeros(catheter.start_m.shape[0])
        self._source = np.zeros(world.system.rows.capacity, np.int32)
        self._films = range(0)

    def add_rows(self, world: World, dt_s: float) -> None:
        """Append a film's row to each row of the catheter on the wall."""
        rows = world.system.rows
        first = rows.n_contacts
        append_films(rows.address, self._source)
        self._films = range(first, rows.n_contacts)

    def set_friction(self, world: World, dt_s: float) -> None:
        """Activate the films that reach the wall, now that all gaps are known."""
        films, film_m = (self._films.start, self._films.stop), self.settings.film_m
        wet_films(world.system.rows.address, films, self._source, self._weight, (dt_s / self._b_n_s_m, film_m))


@kernel
def append_films(rows_address: Address[ContactRows], source: IntArray) -> None:
    """Append a film, dry for now, to each row of the catheter against the wall, and list these rows in ``source``."""
    rows = rows_at(rows_address)
    first = rows.n_contacts
    for on_wall in range(first):
        if _is_catheter_on_wall(rows, on_wall):
            row = append_copy(rows, on_wall, _FILM)
            if row != NO_ROOM:
                source[row - first] = on_wall


@kernel
def wet_films(
    rows_address: Address[ContactRows],
    films: tuple[int, int],
    source: IntArray,
    weight: FloatArray,
    sizes: tuple[float, float],
) -> None:
    """Set the tangential compliance of the films, rows films[0] to films[1], where the gap is within the film.

    ``sizes`` is (dt / b of one particle, film thickness). A particle's b is divided among its films in proportion to
    their weights, whose sums are in ``weight`` (n,). A point between two particles without other films has b once.
    """
    rows, (first, end), (softness, film_m) = rows_at(rows_address), films, sizes
    weight[:] = 0.0
    for film in range(first, end):
        if rows.gap_m[source[film - first]] <= film_m:
            for side in range(2):
                weight[rows.rod_node[film, side]] += rows.rod_weight[film, side]
    for film in range(first, end):
        if rows.gap_m[source[film - first]] <= film_m:
            share = 0.0
            for side in range(2):
                share += rows.rod_weight[film, side] / max(weight[rows.rod_node[film, side]], 1.0)
            rows.softness_m_n[film, 1] = rows.softness_m_n[film, 2] = softness / share


@kernel
def _is_catheter_on_wall(rows: ContactRows, row: int) -> bool:
    on_wall = rows.duct_weight[row, 0] + rows.duct_weight[row, 1] + rows.duct_weight[row, 2] > 0.0
    return bool(on_wall and rows.tool[row] == NO_TOOL and rows.stone[row] == NO_STONE)
