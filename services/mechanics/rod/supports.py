"""Supports of a rod: prescribed particles, clamped ends, and the introducer that it slides through."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled.struct import Struct


class IntroducerSprings(Struct):
    """The numbers of an introducer for kernels; `Introducer` describes them."""

    entry: Annotated[FloatArray, 3]
    axis: Annotated[FloatArray, 3]  # unit vector from entry to exit
    length: float
    stiffness: float
    friction: float
    bearing_length: float
    seal: float
    stop_stiffness: float
    least_tip: float
    is_there: bool = False  # a rod without an introducer has one of zeros


@dataclass(frozen=True)
class Introducer:
    """A straight rigid tube that lets the rod slide only along its axis.

    Springs pull every particle between entry and exit to the axis, and the points of the centreline nearest to entry
    and exit to these. Those points move continuously along the rod, so forces are continuous when it slides. The rod
    must start inside and cannot leave: its first particle stops two segments before the exit (the real catheter
    continues behind the modelled part), and its last ``least_tip_m`` cannot be drawn in.

    Attributes:
        entry_m, exit_m: (3,) ends of the axis; the rod passes from entry to exit in the order of its particles.
        lateral_stiffness_n_m: Of each spring. Any value is stable in the implicit integrator.
        friction: Coulomb coefficient of the wall, 0 for none. The integrators ignore it: this friction and that of the
            seal are solved with the contacts, see `trocar.services.mechanics.contact.seal`.
        bearing_length_m: Length along the axis over which a force of the wall is spread in the computation of friction,
            because a rod model does not resolve a few diameters.
        seal_friction_n: Friction of a seal at the exit, independent of the normal force of the wall.
        stop_stiffness_n_m: Of both stops.
        least_tip_m: Length at the end of the rod that always stays beyond the exit, so that it can be grasped again.
    """

    entry_m: ArrayLike
    exit_m: ArrayLike
    lateral_stiffness_n_m: float = 1e5
    friction: float = 0.0
    bearing_length_m: float = 8e-3
    seal_friction_n: float = 0.0
    stop_stiffness_n_m: float = 2e4
    least_tip_m: float = 5e-3

    def springs(self) -> IntroducerSprings:
        """Return the numbers for kernels. Raises ValueError if one of them is invalid; the message names it."""
        entry = np.array(self.entry_m, dtype=np.float64)
        axis = np.asarray(self.exit_m, dtype=np.float64) - entry
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise ValueError("the entry and exit of an introducer must be apart")
        if not min(self.lateral_stiffness_n_m, self.stop_stiffness_n_m, self.bearing_length_m) > 0.0:
            raise ValueError("an introducer needs positive stiffnesses, and a positive bearing_length_m")
        if not min(self.friction, self.seal_friction_n, self.least_tip_m) >= 0.0:
            raise ValueError("the friction of an introducer, of its seal, and least_tip_m must be at least 0")
        return IntroducerSprings(
            entry=entry,
            axis=axis / length,
            length=length,
            stiffness=self.lateral_stiffness_n_m,
            friction=self.friction,
            bearing_length=self.bearing_length_m,
            seal=self.seal_friction_n,
            stop_stiffness=self.stop_stiffness_n_m,
            least_tip=self.least_tip_m,
            is_there=True,
        )


@dataclass(frozen=True)
class Supports:
    """The supports of a rod.

    Attributes:
        held: Particles (negative numbers count from the end) whose position is prescribed in each step; see
            ``held_target_m`` of the integrator.
        start_direction, end_direction: (3,) direction of a wall at the first or last particle, in the order of the
            particles; None lets the tangent rotate freely. A half joint of stiffness 2 EI/l0 connects wall and segment:
            if the particle is held too, this is the clamped end of beam theory, to second order in l0.
        introducer: The introducer through which the rod slides, or None.
    """

    held: tuple[int, ...] = ()
    start_direction: ArrayLike | None = None
    end_direction: ArrayLike | None = None
    introducer: Introducer | None = field(default=None)

    def held_indices(self, n_particles: int) -> IntArray:
        """Return the sorted indices of held particles. Raises ValueError if one is outside the rod, or named twice."""
        indices = sorted(i + n_particles if i < 0 else i for i in self.held)
        if any(not 0 <= i < n_particles for i in indices) or len(set(indices)) != len(indices):
            raise ValueError(f"held particles {self.held} must be different and within the {n_particles} of the rod")
        return np.array(indices, dtype=np.int32)

    def wall_directions(self) -> FloatArray:
        """Return the unit directions (2, 3) at both ends; NaN rows where there is none."""
        rows = np.full((2, 3), np.nan)
        for row, direction in zip(rows, (self.start_direction, self.end_direction), strict=True):
            if direction is not None:
                row[:] = np.asarray(direction, dtype=np.float64)
                norm = float(np.linalg.norm(row))
                if not norm > 0.0:
                    raise ValueError("the direction of a clamped end must not be zero")
                row /= norm
        return rows


def clamped(direction: ArrayLike) -> Supports:
    """Return the supports of a cantilever: the first particle is held, and a wall gives its tangent this direction."""
    return Supports(held=(0,), start_direction=direction)
