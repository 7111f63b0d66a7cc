"""A partial cut across a duct, as it is made for a catheter."""

from __future__ import annotations

from dataclasses import dataclass

from trocar.services.mechanics.surface.incision import Incision, check_incision


@dataclass(frozen=True, slots=True, kw_only=True)
class IncisionScene:
    """A cut across the duct, ``at_m`` behind its mouth along the wall.

    It opens ``depth``, a share of the circumference, in the middle of the side that faces ``front``, a direction of the
    scene. There it gapes by ``length_m`` along the duct, and closes to both ends of the cut like a lens. What lies
    before it hangs on the wall that is left.
    """

    at_m: float = 8e-3
    depth: float = 0.5
    length_m: float = 2e-3
    front: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def incision(self) -> Incision:
        """Return the cut. Raises ValueError that names the key of a number with which nothing can be cut."""
        cut = Incision(self.at_m, self.depth, self.length_m, self.front)
        try:
            check_incision(cut)
        except ValueError as error:
            raise ValueError(f"duct.incision.{error}") from None
        return cut
