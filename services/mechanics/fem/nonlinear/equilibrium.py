"""Paths of equilibrium under load control: Newton's method at growing parts of a load."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.nonlinear.corotational import Configuration, CorotationalShell
from trocar.services.mechanics.fem.nonlinear.follower_loads import NonlinearLoad
from trocar.services.mechanics.fem.nonlinear.newton import Newton, NotConvergedError

SMALLEST_STEP = 1e-4
"""Part of a regular step below which a path is given up."""
EASY, HARD = 5, 9
"""Iterations below which the next step is longer, above which it is shorter."""
GROWTH = 1.5


@dataclass(frozen=True)
class PathSettings:
    """How to follow a path.

    Attributes:
        n_steps: Parts into which the load is divided, each of them a point of the path; one that does not converge is
            halved.
        tolerance: Unbalanced force over load and reactions.
    """

    n_steps: int = 10
    tolerance: float = 1e-8


@dataclass(frozen=True)
class PathPoint:
    """One equilibrium on the path.

    Attributes:
        part: Of the full load and of the imposed displacements, 1 at the end.
        at: Positions and rotations.
        reaction: (n, 6) force (N) and moment (N m) that the supports exert, zero at free dofs.
        iterations, residual: Newton's steps, and what remained unbalanced.
    """

    part: float
    at: Configuration
    reaction: FloatArray
    iterations: int
    residual: float


def trace_path(
    shell: CorotationalShell,
    load: NonlinearLoad,
    settings: PathSettings | None = None,
    on_point: Callable[[PathPoint], None] = lambda point: None,
) -> list[PathPoint]:
    """Equilibria from the undeformed shell to the full load, at least ``n_steps`` of them.

    The load grows in equal parts, each of them a point; a part is halved where Newton's method fails. A path on which
    the load falls cannot be followed this way.
    Raises ValueError if the path cannot be followed; the message says how far it went.
    """
    settings = settings or PathSettings()
    newton = Newton(shell, load, settings.tolerance)
    regular = 1.0 / settings.n_steps
    at, part, step = Configuration.undeformed(shell.model), 0.0, regular
    points = []
    while part < 1.0:
        stop = (math.floor(part * settings.n_steps + 1e-9) + 1) / settings.n_steps
        target = stop if part + step > stop - 1e-9 * regular else part + step
        try:
            found = newton.solve(at, part, target)
        except NotConvergedError as error:
            step = 0.5 * (target - part)
            if step < SMALLEST_STEP * regular:
                raise lost_path(part, error, "where a shell snaps, arc-length control follows it") from error
            continue
        at, part = found.at, target
        points.append(PathPoint(part, at, found.reaction, found.iterations, found.residual))
        on_point(points[-1])
        step = adapted_step(step, found.iterations, regular)
    return points


def adapted_step(step: float, iterations: int, longest: float) -> float:
    """Return the next step: longer where Newton's method was quick, shorter where it was slow."""
    if iterations <= EASY:
        return min(step * GROWTH, longest)
    return step / GROWTH if iterations >= HARD else step


def lost_path(part: float, error: NotConvergedError, hint: str) -> ValueError:
    """Return the error of a path that could not be followed beyond ``part`` of the load."""
    return ValueError(f"nonlinear: no equilibrium was found beyond {part:.4g} of the load ({error}); {hint}")
