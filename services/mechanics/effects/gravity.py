"""Weight of the catheter and of the duct's wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.effects.base import Effect
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.surface.mesh import TriangleMesh, vertex_areas_m2
from trocar.services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class GravitySettings:
    """Acceleration of gravity in scene axes; a patient lies with +z up.

    The duct hangs in its ligaments and its shape was recorded there, so its own weight is already part of that shape,
    unless ``on_duct`` is set.
    """

    acceleration_m_s2: tuple[float, float, float] = (0.0, 0.0, -9.81)
    on_duct: bool = False


class Gravity(Effect):
    """Constant forces m g on the catheter's particles and, if wanted, on the modes of the duct.

    Conservative: the work it does is the change of the potential energy, which `potential_energy_j` reports. The duct's
    rest shape includes the static part of its own weight that the modes leave out.
    """

    Settings = GravitySettings
    of_wall = True

    def __init__(self, settings: GravitySettings, scene: SceneModel) -> None:
        super().__init__(settings, scene)
        self._surface_density = scene.duct.density_kg_m3 * scene.duct.thickness_m
        self._g = np.array(settings.acceleration_m_s2, dtype=np.float64)

    def constant_load_n(self, mesh: TriangleMesh) -> FloatArray:
        """Weight of the wall (n, 3), a third of each triangle on each corner."""
        density = self._surface_density if self.settings.on_duct else 0.0
        load: FloatArray = (density * vertex_areas_m2(mesh))[:, None] * self._g
        return load

    def body_acceleration_m_s2(self) -> FloatArray:
        """Return g (3,)."""
        return self._g

    def prepare(self, world: World) -> None:
        """Set the particles' weights as constant loads, if there are any."""
        if self.scene.duct_alone:
            return
        self._weight_n = world.catheter.properties.particle_mass_kg()[:, None] * self._g
        world.catheter.constant_force_n += self._weight_n

    def potential_energy_j(self, world: World) -> float:
        """Potential energy of the catheter, zero at the origin."""
        return -float(np.sum(self._weight_n * world.catheter.state.position_m))
