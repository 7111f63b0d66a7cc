"""An effect of your own, a current that carries the catheter along: ``python -m trocar.examples.own_effect``."""

# %% Settings with units in their names, and a class that acts in the stages that it overrides
from dataclasses import dataclass, replace

import numpy as np

import trocar


@dataclass(frozen=True, slots=True)
class CurrentSettings:
    """Force on every particle of the catheter, in scene axes."""

    force_n: tuple[float, float, float] = (0.0, 1e-4, 0.0)


class Current(trocar.Effect):
    """A constant force on every particle: conservative."""

    Settings = CurrentSettings

    def prepare(self, world: trocar.World) -> None:
        """Keep the force."""
        self._force_n = np.array(self.settings.force_n)

    def add_loads(self, world: trocar.World, dt_s: float) -> None:
        """Push the particles."""
        world.catheter.external_force_n += self._force_n

    def potential_energy_j(self, world: trocar.World) -> float:
        """Less by what the current has moved."""
        return -float(np.sum(world.catheter.state.position_m @ self._force_n))


trocar.add_effect("current", Current, "a steady current that carries the catheter along")

# %% The same scene with and without it, no hand in it, for a quarter of a second
scene = trocar.load_scene("insertion")
for name, effects in (("without", scene.effects), ("with", {**scene.effects, "current": CurrentSettings()})):
    simulation, hands = trocar.simulate(replace(scene, effects=effects)), trocar.Hands()
    hands.present[:] = False
    start_m = trocar.tip_m(simulation)
    for _ in range(250):
        simulation.step(hands)
    x_mm, y_mm, z_mm = 1e3 * (trocar.tip_m(simulation) - start_m)
    print(f"{name:7} the current the tip moves by {x_mm:6.2f} {y_mm:6.2f} {z_mm:6.2f} mm")
