"""Paths of equilibrium by Crisfield's cylindrical arc length, which also follow a load that falls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.nonlinear import CorotationalShell, NonlinearLoad, PathPoint, PathSettings
from trocar.services.mechanics.fem.nonlinear.corotational import Configuration
from trocar.services.mechanics.fem.nonlinear.equilibrium import SMALLEST_STEP, adapted_step, lost_path
from trocar.services.mechanics.fem.nonlinear.newton import MOST_ITERATIONS, Newton, NotConvergedError

MOST_POINTS = 500
"""Of a path: it may wind for ever."""


def trace_arc_length(
    shell: CorotationalShell,
    load: NonlinearLoad,
    settings: PathSettings | None = None,
    on_point: Callable[[PathPoint], None] = lambda point: None,
    most_points: int = MOST_POINTS,
) -> list[PathPoint]:
    """Equilibria along the path until the load is full; the last one is found at the full load.

    Raises ValueError if the path cannot be followed; the message says how far it went.

    Args:
        shell, load, settings, on_point: As in `trocar.services.mechanics.fem.nonlinear.trace_path`; the first step is
        as long
            as that of the load would be.
        most_points: After which the path is given up.
    """
    settings = settings or PathSettings()
    newton = Newton(shell, load, settings.tolerance)
    arc = ArcLength(newton)
    state = arc.start(1.0 / settings.n_steps)
    shortest, longest = SMALLEST_STEP * state.length, state.length
    points: list[PathPoint] = []
    for _ in range(most_points):
        try:
            after = arc.advance(state)
            last = newton.solve(state.at, state.part, 1.0) if after.part >= 1.0 else None
        except NotConvergedError as error:
            state = state.with_length(0.5 * state.length)
            if state.length < shortest:
                hint = f"more n_steps than {settings.n_steps} begin with shorter ones, which lose a path less easily"
                raise lost_path(state.part, error, hint) from error
            continue
        if last is not None:
            points.append(PathPoint(1.0, last.at, last.reaction, last.iterations, last.residual))
            on_point(points[-1])
            return points
        state = after.with_length(adapted_step(after.length, after.iterations, longest))
        points.append(PathPoint(after.part, after.at, after.reaction, after.iterations, after.residual))
        on_point(points[-1])
    hint = "fewer n_steps make longer ones" if state.length == longest else "more n_steps may take more points"
    raise ValueError(f"nonlinear: after {most_points} points the path is at {state.part:.3g} of the load; {hint}")


@dataclass(frozen=True)
class ArcState:
    """A point of the path, and the step that led to it.

    Attributes:
        part, at, reaction, iterations, residual: See `equilibrium.PathPoint`.
        last: (6 n,) the step that led here, zero at the start; the next one goes on in its direction.
        length: Norm of the next step's translations in m.
    """

    part: float
    at: Configuration
    reaction: FloatArray
    iterations: int
    residual: float
    last: FloatArray
    length: float

    def with_length(self, length: float) -> ArcState:
        """The same point with another length for the next step."""
        return replace(self, length=length)


class ArcLength:
    """Crisfield's cylindrical arc length: |step of translations| is given, the load is an unknown.

    M. A. Crisfield, Computers and Structures 13:55 (1981). Of the two points of the path on the cylinder the one is
    taken whose step turns least from the one so far.
    """

    def __init__(self, newton: Newton) -> None:
        self._newton = newton
        self._is_translation = np.arange(6 * newton.shell.model.mesh.n_vertices) % 6 < 3

    def start(self, first_part: float) -> ArcState:
        """The undeformed shell; the first step is as long as ``first_part`` of the load would move it linearly."""
        newton = self._newton
        at = Configuration.undeformed(newton.shell.model)
        _, by_load = self._directions(at, 0.0, None)
        zero = np.zeros(len(by_load))
        length = first_part * float(np.linalg.norm(by_load[self._is_translation]))
        return ArcState(0.0, at, zero.reshape(-1, 6), 0, 0.0, zero, length)

    def advance(self, state: ArcState) -> ArcState:
        """Next point of the path. Raises NotConvergedError if none was found at this length."""
        newton, at, part = self._newton, state.at, state.part
        _, by_load = self._directions(at, part, None)
        delta = state.length / float(np.linalg.norm(by_load[self._is_translation]))
        if state.last.any() and self._dot(by_load, state.last) < 0.0:
            delta = -delta
        step = total = delta * by_load
        carried = newton.shell.carried_after(at, step)
        at, part = at.moved(total), part + delta
        for iteration in range(1, MOST_ITERATIONS):
            unbalanced, inside = self._unbalanced(at, part)
            residual = newton.residual(unbalanced, inside)
            if residual <= newton.tolerance:
                return ArcState(part, at, newton.reaction(unbalanced), iteration, residual, total, state.length)
            by_residual, by_load = self._directions(at, part, carried)
            delta = self._on_cylinder(total, by_residual, by_load, state.length)
            step = by_residual + delta * by_load
            carried = newton.shell.carried_after(at, step)
            at, part, total = at.moved(step), part + delta, total + step
        raise NotConvergedError(f"residual {residual:.1g} after {MOST_ITERATIONS} iterations")

    def _on_cylinder(self, total: FloatArray, by_residual: FloatArray, by_load: FloatArray, length: float) -> float:
        so_far = total + by_residual
        a = self._dot(by_load, by_load)
        b = 2.0 * self._dot(by_load, so_far)
        c = self._dot(so_far, so_far) - length**2
        discriminant = b * b - 4.0 * a * c
        if discriminant < 0.0:
            raise NotConvergedError("the path leaves the cylinder of this length")
        root = np.sqrt(discriminant)
        roots = ((-b - root) / (2.0 * a), (-b + root) / (2.0 * a))
        along = [self._dot(total, so_far + delta * by_load) for delta in roots]
        return float(roots[0] if along[0] > along[1] else roots[1])

    def _dot(self, one: FloatArray, other: FloatArray) -> float:
        return float(one[self._is_translation] @ other[self._is_translation])

    def _unbalanced(self, at: Configuration, part: float) -> tuple[FloatArray, FloatArray]:
        newton = self._newton
        inside = newton.shell.forces(at)
        return part * newton.load.forces(newton.shell.model.mesh, at.position_m) - inside, inside

    def _directions(self, at: Configuration, part: float, carried: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """(6 n,) steps that would take away what is unbalanced, and that the full load makes."""
        newton = self._newton
        inside, K = newton.shell.forces(at), newton.tangent(at, part, carried)
        full = newton.load.forces(newton.shell.model.mesh, at.position_m)
        held = np.zeros(len(inside))
        held[newton.held] = newton.imposed
        factors = newton.factorise(K)
        by_residual, by_load = np.zeros(len(inside)), held
        by_residual[newton.free] = factors.solve((part * full - inside)[newton.free])
        by_load[newton.free] = factors.solve((full - np.asarray(K @ held))[newton.free])
        return by_residual, by_load
