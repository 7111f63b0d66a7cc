"""Large rotations: a strongly bent duct keeps its volume, because its sections turn instead of shearing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from trocar.services.mechanics.effects.base import Effect
from trocar.services.mechanics.reduction.large_rotations.sections import cut_sections, refuse_unless_tube
from trocar.services.mechanics.reduction.large_rotations.warping import TubeWarp
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class LargeRotationsSettings:
    """Number of sections that the duct's axis is divided into."""

    n_sections: int = 24

    def __post_init__(self) -> None:
        if self.n_sections < 2:
            raise ValueError(f"n_sections must be at least 2, is {self.n_sections}")


class LargeRotations(Effect):
    """Turned cross-sections in all positions of the wall: contact, detection, mouth, picture.

    It acts through the duct itself (`ReducedDuct.warp`), which every process holds.
    Constant loads (gas pressure; weight of the wall) turn with the sections they act on.
    """

    Settings = LargeRotationsSettings
    of_wall = True

    def check_mesh(self, mesh: TriangleMesh) -> None:
        """Check that the mesh can be divided into cross-sections.

        Raises ValueError if the surface is not a tube held at one end, or its mesh is too coarse for the sections.
        """
        held = mesh.vertex_sets["clamped"]
        with _named():
            refuse_unless_tube(mesh, held)
            cut_sections(mesh, held, self.settings.n_sections)

    def modify_duct(self, duct: ReducedDuct) -> ReducedDuct:
        """Return the duct with its warp; raises as `check_mesh` does."""
        held = duct.mesh.vertex_sets["clamped"]
        with _named():
            refuse_unless_tube(duct.mesh, held)
            warp = TubeWarp.from_basis(duct.mesh, duct.basis, held, self.settings.n_sections)
        return replace(duct, warp=warp)

    def prepare(self, world: World) -> None:
        """Check that the duct was reduced for this scene."""
        if world.duct.reduced.warp is None:
            raise ValueError("effects.large_rotations: the duct was built without it, use build_scene_duct")


@contextmanager
def _named() -> Iterator[None]:
    """Prefix a ValueError with the effect's name."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"effects.large_rotations: {error}") from error
