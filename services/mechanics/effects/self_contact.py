"""The catheter touching itself where it loops."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.strands import self_clearance_m
from trocar.services.mechanics.effects.base import Effect, require_positive
from trocar.services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class SelfContactSettings:
    """Segments closer along the catheter than this many diameters are not tested against each other.

    The distance is rounded up to whole segments, and is at least two.
    """

    neighbour_diameters: float = 4.0

    def __post_init__(self) -> None:
        require_positive(self, "neighbour_diameters")


class SelfContact(Effect):
    """Contacts between segments of the catheter, found, solved and priced with all the others.

    Detection remembers on which side of each other two segments are, so strands pressed into each other are pushed back
    and not through.
    """

    Settings = SelfContactSettings
    can_rest = True

    def prepare(self, world: World) -> None:
        """Convert the distance in diameters to one in segments, and let them be found."""
        catheter = world.catheter
        properties, radius_m = catheter.properties, catheter.radius_m
        between = math.ceil(self.settings.neighbour_diameters * 2.0 * radius_m / properties.segment_length_m)
        self._n_apart, self._thickness_m, self._search = max(between, 2) + 1, 2.0 * radius_m, world.search
        self._search.set_strands(self._n_apart)

    def most_motion_m(self, particles_m: FloatArray) -> float:
        """Return half the least gap: two strands may close it from both sides."""
        return 0.5 * float(self_clearance_m(particles_m, self._n_apart, self._thickness_m))

    def rest(self) -> None:
        """Let strands pass through each other."""
        self._search.set_strands(0)

    def wake(self) -> None:
        """Find strands again, on the sides of each other that they are on now."""
        self._search.set_strands(self._n_apart)
