"""Viscous drag of the mucus film between catheter and wall."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, pairs_at
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.compiled.vectors import between, dot, put_row, row, subtract
from trocar.services.mechanics.contact.geometry import ContactGeometry, geometry_at
from trocar.services.mechanics.contact.identity import pair_identity
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.rows import ContactRows, rows_at
from trocar.services.mechanics.contact.writer import FIRST_SIDE, NO_ROOM, append_copy, put_on_rod
from trocar.services.mechanics.effects.base import Effect, require_positive
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.world import World

_FILM, _NONE = number_of("film"), -1
FilmPlaces = tuple[IntArray, FloatArray]
"""For each particle the pair that is nearest to it, or `_NONE`, and how far that is in m; scratch."""


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
    particle has one film however many facets it is near, to the nearest of them.
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
        self._source = np.zeros(world.system.rows.capacity, np.int32)
        n_particles = catheter.start_m.shape[0]
        self._nearest = np.zeros(n_particles, np.int32), np.zeros(n_particles)
        self._films = range(0)

    def add_rows(self, world: World, dt_s: float) -> None:
        """Append a film's row for each particle that the film may reach."""
        rows = world.system.rows
        first = rows.n_contacts
        addresses = rows.address, world.pairs.address, world.system.geometry.address
        append_films(addresses, self.settings.film_m, self._nearest, self._source)
        self._films = range(first, rows.n_contacts)

    def set_friction(self, world: World, dt_s: float) -> None:
        """Activate the films that reach the wall, now that all gaps are known."""
        films, film_m = (self._films.start, self._films.stop), self.settings.film_m
        wet_films(world.system.rows.address, films, self._source, (dt_s / self._b_n_s_m, film_m))


@kernel
def append_films(
    addresses: tuple[Address[ContactRows], Address[ContactPairs], Address[ContactGeometry]],
    film_m: float,
    nearest: FilmPlaces,
    source: IntArray,
) -> None:
    """Append a film, dry for now, for each particle, against the nearest point of a pair of its segments with the wall.

    The rows of these pairs, which have the same order as the pairs, are listed in ``source``.
    """
    rows, pairs, rod = rows_at(addresses[0]), pairs_at(addresses[1]), geometry_at(addresses[2]).rod
    pair = nearest[0]
    _find_nearest(pairs, rod.position, film_m, nearest)
    first, on_wall = rows.n_contacts, 0
    for index in range(pairs.count):
        if not _is_catheter_on_wall(pairs, index, pair.shape[0]):
            continue
        segment = pairs.particle[index]
        identity = pair_identity(NO_TOOL, 0, segment, DUCT_TRIANGLE, pairs.target[index])
        while on_wall < first and rows.identity[on_wall] != identity:
            on_wall += 1
        for particle in range(segment, segment + 2):
            if on_wall == first or pair[particle] != index:
                continue
            added = append_copy(rows, on_wall, _FILM)
            if added != NO_ROOM:
                source[added - first] = on_wall
                put_on_rod(rows, added, FIRST_SIDE, (particle, particle), (1.0, 0.0))
                put_row(rows.slip_m, added, row(rod.motion, particle))
        on_wall = min(on_wall + 1, first)


@inlined_kernel
def _find_nearest(pairs: ContactPairs, particles: FloatArray, film_m: float, out: FilmPlaces) -> None:
    """Write for each particle which pair has the nearest point, of those whose tangent plane the film reaches."""
    out[0][:], out[1][:] = _NONE, math.inf
    for index in range(pairs.count):
        if not _is_catheter_on_wall(pairs, index, particles.shape[0]):
            continue
        segment, normal = pairs.particle[index], row(pairs.normal, index)
        ends = row(particles, segment), row(particles, segment + 1)
        place = between(ends[0], ends[1], pairs.tool_parameter[index])
        for end in range(2):
            away = subtract(ends[end], place)
            distance_m = pairs.gap_m[index] + math.sqrt(dot(away, away))
            is_reached = pairs.gap_m[index] + dot(normal, away) <= film_m
            if is_reached and distance_m < out[1][segment + end]:
                out[0][segment + end], out[1][segment + end] = index, distance_m


@inlined_kernel
def _is_catheter_on_wall(pairs: ContactPairs, index: int, n_particles: int) -> bool:
    """Return whether the first body of a pair with the wall is the catheter; stones are numbered after its segments."""
    is_on_wall = pairs.tool[index] == NO_TOOL and pairs.target_kind[index] == DUCT_TRIANGLE
    return bool(is_on_wall and pairs.particle[index] < n_particles - 1)


@kernel
def wet_films(
    rows_address: Address[ContactRows], films: tuple[int, int], source: IntArray, sizes: tuple[float, float]
) -> None:
    """Set the tangential compliance of the films, rows films[0] to films[1], where the gap is within the film.

    ``sizes`` is (dt / b, film thickness).
    """
    rows, (first, end), (softness, film_m) = rows_at(rows_address), films, sizes
    for film in range(first, end):
        if rows.gap_m[source[film - first]] <= film_m:
            rows.softness_m_n[film, 1] = rows.softness_m_n[film, 2] = softness
