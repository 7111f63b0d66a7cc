"""Contacts of the tools' shafts, tips and jaws with the wall of the duct and with the catheter."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from services.mechanics.arrays import AnyArray, BoolArray, FloatArray
from services.mechanics.collision.beside import Beside
from services.mechanics.collision.capsules import CapsuleMemory
from services.mechanics.collision.pairs import JAW_A, JAW_B, ContactPairs
from services.mechanics.collision.probes import Probes
from services.mechanics.collision.surface import CollisionSurface
from services.mechanics.collision.tools_kernels import (
    N_SEGMENTS,
    PROBES_PER_TOOL,
    ToolDetection,
    detect_tools,
    forget_far,
)


class ToolContactDetector:
    """Finds pairs of tool segments with duct triangles and catheter segments.

    A segment is cut into probes with one or two contacts each, so that one lying along the wall is carried by a
    few well spread points that stay where they are from tick to tick.

    Parameters
    ----------
    surface : CollisionSurface
        Updated by the caller before every `detect`.
    n_particles : int
        Particles of the catheter, one more than its segments; 0 without a catheter.
    catheter_radius_m : float
    margin_m : float
        Pairs are reported from this gap on.
    n_tools : int
    """

    def __init__(
        self,
        surface: CollisionSurface,
        n_particles: int,
        catheter_radius_m: float,
        margin_m: float,
        n_tools: int = 2,
    ) -> None:
        if not margin_m > 0.0:
            raise ValueError(f"margin_m must be positive, got {margin_m}")
        self.surface = surface
        self._detection = ToolDetection(
            shell=surface.shell,
            probes=Probes.allocate(n_tools * PROBES_PER_TOOL, surface.n_modes),
            beside=Beside.zeros(
                p=n_tools * PROBES_PER_TOOL, m=len(surface.mesh.triangles), wall_m=2.0 * surface.half_thickness_m
            ),
            capsules=CapsuleMemory.zeros(m=n_tools * N_SEGMENTS, n=max(n_particles - 1, 0)),
            half_thickness_m=surface.half_thickness_m,
            catheter_radius_m=catheter_radius_m,
            margin_m=margin_m,
        )
        self._shapes = ((n_tools, N_SEGMENTS, 2, 3), (n_tools, N_SEGMENTS), (n_particles, 3), (n_tools,))
        self._everyone = np.ones(n_tools, np.bool_)

    def reset(self) -> None:
        """Forget the past: the next `detect` finds the sides from the positions alone."""
        self._detection.probes.reset()
        self._detection.capsules.reset()

    def look_afresh(self, tool: int) -> None:
        """Forget the past of one tool that has touched nothing yet: it may be withdrawn through what it is in."""
        self._detection.probes.reset(slice(tool * PROBES_PER_TOOL, (tool + 1) * PROBES_PER_TOOL))
        self._detection.capsules.reset(slice(tool * N_SEGMENTS, (tool + 1) * N_SEGMENTS))

    def take_up(self, segments_m: FloatArray, radii_m: FloatArray) -> None:
        """Forget what may not be so any more: somebody else has looked of late, and tools were elsewhere then.

        What has come no further than it reaches since has not gone round the wall, wherever it was in between.
        """
        forget_far(self._detection.address, (segments_m, radii_m, self._everyone))
        self._detection.capsules.reset()

    def stand_still(self) -> None:
        """Forget how tools have come to where they are: they have been taken up there."""
        beside = self._detection.beside
        beside.motion[:] = 0.0
        beside.closing[:] = 0.0

    def let_through(self, tool: int) -> None:
        """Forget on which side of a tool's jaws the catheter is: while they hold it they do not push it back.

        It may slip through them. Who says so before every `detect` then finds it where it is once they let go.
        """
        first = tool * N_SEGMENTS
        self._detection.capsules.reset(slice(first + JAW_A, first + JAW_B + 1))

    @contextmanager
    def all_within(self, close_m: float) -> Iterator[None]:
        """Let `detect` find everything that is nearer than this to a piece of a tool that is as near to the wall.

        A tick finds the closest points, and beside them what is met as things move; that is not all where a step ends.
        """
        beside = self._detection.beside
        beside.close_m = close_m
        yield
        beside.close_m = 0.0

    def state_arrays(self) -> list[AnyArray]:
        """Return the live arrays of the past."""
        detection = self._detection
        return [array for part in (detection.probes, detection.capsules) for array in part.own_arrays()]

    def detect(
        self,
        segments_m: FloatArray,
        radii_m: FloatArray,
        particle_positions_m: FloatArray,
        pairs_out: ContactPairs,
        present: BoolArray | None = None,
    ) -> None:
        """Append the pairs of this tick.

        Parameters
        ----------
        segments_m : (n_tools, 3, 2, 3) float64
            Start and end of shaft (port to junction) and jaws (junction to tip). A segment without length is a
            sphere.
        radii_m : (n_tools, 3) float64
            0 where a tool has no such segment.
        particle_positions_m : (n, 3) float64
        pairs_out : ContactPairs
        present : (n_tools,) bool, optional
            An absent tool touches nothing and loses its past.
        """
        who = self._everyone if present is None else present
        shapes = (segments_m.shape, radii_m.shape, particle_positions_m.shape, who.shape)
        if shapes != self._shapes:
            raise ValueError(f"segments, radii, particles and present have shapes {shapes}, not {self._shapes}")
        detect_tools(self._detection.address, (segments_m, radii_m, who), particle_positions_m, pairs_out.address)
