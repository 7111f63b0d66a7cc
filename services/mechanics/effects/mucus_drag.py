"""Viscous drag of the mucus film between catheter and wall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from services.mechanics.collision.pairs import NO_TOOL
from services.mechanics.compiled import kernel
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.solver import FILM
from services.mechanics.effects.base import Effect

if TYPE_CHECKING:
    from services.mechanics.simulation import Simulation


@dataclass(frozen=True, slots=True)
class MucusDragSettings:
    """Viscosity of the film at the rates of an insertion, and its thickness, which is also its reach; assumptions."""

    viscosity_pa_s: float = 0.5
    film_m: float = 0.3e-3


class MucusDrag(Effect):
    """Couette drag of each particle against the wall it is near: f = -b v with b = viscosity * area / film.

    The area is a segment's length times its diameter. Solved with the contacts, as a row that holds the tangents with
    the compliance dt / b: implicit, so that any viscosity is stable; equal and opposite on catheter and wall.
    """

    Settings = MucusDragSettings

    def prepare(self, simulation: Simulation) -> None:
        """Work out b."""
        catheter = simulation.catheter
        area = catheter.properties.segment_length_m * 2.0 * catheter.radius_m
        self._b_n_s_m = self.settings.viscosity_pa_s * area / self.settings.film_m
        self._rows = 0

    def add_loads(self, simulation: Simulation, dt_s: float) -> None:
        """Keep the step for the rows, which are made when the contacts are known."""
        self._softness = dt_s / self._b_n_s_m

    def add_rows(self, simulation: Simulation, rows: ContactRows) -> None:
        """Double the rows of the catheter on the wall by a film."""
        append_films(rows, self._softness)


# So soft along the normal that a film carries no load there: 1 N for a kilometre.
_NO_NORMAL_M_N = 1e3


@kernel
def append_films(rows: ContactRows, softness: float) -> None:
    """Append one film per present row of a particle against the wall."""
    for source in range(rows.used[0]):
        row = rows.used[0]
        on_wall = rows.duct_weight[source, 0] + rows.duct_weight[source, 1] + rows.duct_weight[source, 2] > 0.0
        if row == rows.gap_m.shape[0] or rows.tool[source] != NO_TOOL or not on_wall or rows.sphere[source] >= 0:
            continue
        rows.kind[row] = FILM
        rows.identity[row] = rows.identity[source] | (1 << 60)
        rows.body[row] = rows.body[source] | (1 << 60)
        rows.tool[row] = NO_TOOL
        rows.sphere[row] = -1
        rows.limit[row] = 1e300
        rows.gap_m[row] = 0.0
        rows.softness_m_n[row, 0] = _NO_NORMAL_M_N
        rows.softness_m_n[row, 1] = rows.softness_m_n[row, 2] = softness
        for axis in range(3):
            rows.point_m[row, axis] = rows.point_m[source, axis]
            rows.slip_m[row, axis] = rows.slip_m[source, axis]
            rows.duct_node[row, axis] = rows.duct_node[source, axis]
            rows.duct_weight[row, axis] = rows.duct_weight[source, axis]
            for other in range(3):
                rows.frame[row, axis, other] = rows.frame[source, axis, other]
        for point in range(rows.rod_node.shape[1]):
            rows.rod_node[row, point] = rows.rod_node[source, point]
            rows.rod_weight[row, point] = rows.rod_weight[source, point]
        rows.used[0] = row + 1
