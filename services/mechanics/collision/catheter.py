"""Contacts of the catheter with the wall of the duct, from inside or outside."""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import AnyArray, ByteArray, FloatArray
from services.mechanics.collision.catheter_kernels import CatheterDetection, detect_catheter, enters_by_openings
from services.mechanics.collision.inside import Lumen
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.collision.probes import Probes
from services.mechanics.collision.rim import RimMemory
from services.mechanics.collision.surface import CollisionSurface


class CatheterContactDetector:
    """Finds pairs of catheter particles and duct triangles, and follows who is in the lumen.

    Parameters
    ----------
    surface : CollisionSurface
        Updated by the caller before every `detect`.
    n_particles : int
    radius_m : float
        Radius of influence of a particle: that of the catheter.
    margin_m : float
        Pairs are reported from this gap on, so that the solver meets a contact before it happens.
    """

    def __init__(self, surface: CollisionSurface, n_particles: int, radius_m: float, margin_m: float) -> None:
        if not (radius_m > 0.0 and margin_m > 0.0):
            raise ValueError(f"radius_m and margin_m must be positive, got {radius_m} and {margin_m}")
        self.surface = surface
        self._shape = (n_particles, 3)
        self._nowhere = np.zeros(self._shape)
        self._detection = CatheterDetection.zeros(
            n=n_particles,
            shell=surface.shell,
            probes=Probes.allocate(n_particles, surface.n_modes),
            lumen=Lumen.allocate(n_particles),
            rims=RimMemory.allocate(max(n_particles - 1, 0)),
            thickness_m=radius_m + surface.half_thickness_m,
            margin_m=margin_m,
        )

    @property
    def inside(self) -> ByteArray:
        """(n,) one where a particle is in the lumen; a live view."""
        return self._detection.lumen.inside

    @property
    def against_m(self) -> FloatArray:
        """(n, 2, 3) how far particles went in the last tick against the walls they were closest to; a live view."""
        return self._detection.against

    def reset(self) -> None:
        """Forget the past: the next `detect` finds sides and insideness from the positions alone."""
        self._detection.probes.reset()
        self._detection.lumen.reset()
        self._detection.rims.reset()

    def enters_by_openings(self) -> bool:
        """Return whether, as last detected, every segment with one end in the lumen is near an opening."""
        found: bool = enters_by_openings(self._detection.address)
        return found

    def state_arrays(self) -> list[AnyArray]:
        """Return the live arrays of the past."""
        detection = self._detection
        return [array for part in (detection.probes, detection.lumen, detection.rims) for array in part.own_arrays()]

    def detect(
        self, particle_positions_m: FloatArray, pairs_out: ContactPairs, ahead_m: FloatArray | None = None
    ) -> None:
        """Append the pairs of this tick for positions (n, 3); ``ahead_m`` (n, 3) is where free particles go in it.

        Of a particle with the wall and of a segment where it crosses the rim of an opening between its particles: with
        the closest point, with what lies opposite, with the other flanks of the folds that these lie in, and with what
        it will slide to.
        """
        if particle_positions_m.shape != self._shape:
            raise ValueError(f"particle positions have shape {particle_positions_m.shape}, not {self._shape}")
        ahead_m = self._nowhere if ahead_m is None else ahead_m
        detect_catheter(self._detection.address, particle_positions_m, ahead_m, pairs_out.address)
