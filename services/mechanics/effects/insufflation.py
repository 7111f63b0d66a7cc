"""Gas pressure of the abdomen on the duct, against the pressure in its lumen."""

from __future__ import annotations

from dataclasses import dataclass

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.effects.base import Effect
from trocar.services.mechanics.fem import pressure_load
from trocar.services.mechanics.surface.mesh import TriangleMesh


@dataclass(frozen=True, slots=True)
class InsufflationSettings:
    """Pressures above the atmosphere: 12 mmHg of carbon dioxide outside, bile inside."""

    outside_pa: float = 1600.0
    inside_pa: float = 1500.0


class Insufflation(Effect):
    """Constant load p n on the wall with p = inside - outside, on the undeformed normals (not a follower load).

    It is conservative. A thin tube of radius R and thickness t collapses at an outside pressure of about
    E t^3 / (4 (1 - nu^2) R^3), which this linear load cannot represent: stay well below.
    """

    Settings = InsufflationSettings
    of_wall = True

    def constant_load_n(self, mesh: TriangleMesh) -> FloatArray:
        """Pressure force (n, 3) on the nodes."""
        return pressure_load(mesh, self.settings.inside_pa - self.settings.outside_pa)
