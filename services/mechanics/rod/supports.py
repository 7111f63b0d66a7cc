"""Supports of a rod: prescribed particles, clamped ends, and the introducer that it slides through."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled.struct import Struct


class IntroducerSprings(Struct):
    """An introducer as kernels see it; `Introducer` describes the numbers."""

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
    """A straight rigid tube that lets the rod slide along its axis only.

    Every particle between entry and exit is pulled to the axis, and the points of the centreline nearest to the entry
    and to the exit are pulled to these. Because those points move continuously along the rod, sliding it by a segment
    changes no force by a jump. The rod has to start in it, and stays: its first particle stops two segments before the
    exit (the catheter goes on behind the piece that is modelled), and the last ``least_tip_m`` cannot be drawn in.

    Attributes:
        entry_m, exit_m: (3,) ends of the axis; the rod passes from entry to exit in the order of its particles.
        lateral_stiffness_n_m: Per constrained point; solved implicitly, so that any value is stable in the implicit
            integrator.
        friction: Coulomb coefficient against the wall, 0 for none. To the rod the introducer is smooth: this friction
            and that of the seal are solved with the contacts, see `services.mechanics.contact.seal`.
        bearing_length_m: Length over which a push of the wall is spread along the axis, for friction: a rod model does
            not resolve a few diameters.
        seal_friction_n: Friction of a seal at the exit, whatever the rod's push on the wall.
        stop_stiffness_n_m: Of both stops.
        least_tip_m: Length at the end of the rod that stays beyond the exit, to be grasped again.
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
        """Return it as the kernels see it. Raises ValueError if a number makes no sense; the message names it."""
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
    """Everything that holds a rod.

    Attributes:
        held: Particles (negative counts from the end) whose position is prescribed each step; see ``held_target_m`` of
            the integrator.
        start_direction, end_direction: (3,) direction, in the order of the particles, that a wall gives the tangent at
            the first or last particle; None lets it turn freely. A half joint of stiffness 2 EI/l0: with the particle
            held it is the clamped end of beam theory, second order in l0.
        introducer: What the rod slides through, or None.
    """

    held: tuple[int, ...] = ()
    start_direction: ArrayLike | None = None
    end_direction: ArrayLike | None = None
    introducer: Introducer | None = field(default=None)

    def held_indices(self, n_particles: int) -> IntArray:
        """Return the sorted indices of held particles. Raises ValueError: one is outside the rod, or named twice."""
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
    """Return the supports of a cantilever: the first particle held and its tangent kept."""
    return Supports(held=(0,), start_direction=direction)
