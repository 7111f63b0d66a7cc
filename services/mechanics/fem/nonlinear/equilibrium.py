"""Paths of equilibrium: Newton's method at growing parts of a load, or along the path's own length."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from services.mechanics.arrays import FloatArray
from services.mechanics.fem.nonlinear.arc_length import ArcLength
from services.mechanics.fem.nonlinear.corotational import Configuration, CorotationalShell
from services.mechanics.fem.nonlinear.loads import NonlinearLoad
from services.mechanics.fem.nonlinear.newton import Newton, NotConvergedError

SMALLEST_STEP = 1e-4
"""Part of a regular step below which a path is given up."""
EASY, HARD = 5, 9
"""Iterations below which the next step is longer, above which it is shorter."""
GROWTH = 1.5


@dataclass(frozen=True)
class PathSettings:
    """How to follow a path.

    Attributes
    ----------
    n_steps
        Parts into which the load is divided, each of them a point of the path; one that does not converge is halved.
    control
        ``load`` raises the load, up to where the shell snaps; ``arc_length`` also follows a path on which the load
        falls (Crisfield's cylinder over the translations, Computers and Structures 13:55, 1981).
    tolerance
        Unbalanced force over load and reactions.
    most_points
        Of a path along its length, which may wind for ever.
    """

    n_steps: int = 10
    control: Literal["load", "arc_length"] = "load"
    tolerance: float = 1e-8
    most_points: int = 500


@dataclass(frozen=True)
class PathPoint:
    """One equilibrium on the path.

    Attributes
    ----------
    part
        Of the full load and of the imposed displacements, 1 at the end.
    at
        Positions and rotations.
    reaction
        (n, 6) force (N) and moment (N m) that the supports exert, zero at free dofs.
    iterations, residual
        Newton's steps, and what remained unbalanced.
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

    Raises
    ------
    ValueError
        The path cannot be followed; the message says how far it went.
    """
    settings = settings or PathSettings()
    newton = Newton(shell, load, settings.tolerance)
    follow = _by_load if settings.control == "load" else _by_arc_length
    points = []
    for point in follow(newton, settings):
        points.append(point)
        on_point(point)
    return points


def _by_load(newton: Newton, settings: PathSettings) -> Iterator[PathPoint]:
    """Equal parts of the load, each of them a point; halved where Newton's method fails, longer where it is easy."""
    regular = 1.0 / settings.n_steps
    at, part, step = Configuration.undeformed(newton.shell.model), 0.0, regular
    while part < 1.0:
        stop = (math.floor(part * settings.n_steps + 1e-9) + 1) / settings.n_steps
        target = stop if part + step > stop - 1e-9 * regular else part + step
        try:
            found = newton.solve(at, part, target)
        except NotConvergedError as error:
            step = 0.5 * (target - part)
            if step < SMALLEST_STEP * regular:
                raise _gave_up(part, error, settings) from error
            continue
        at, part = found.at, target
        yield PathPoint(part, at, found.reaction, found.iterations, found.residual)
        step = _adapted(step, found.iterations, regular)


def _by_arc_length(newton: Newton, settings: PathSettings) -> Iterator[PathPoint]:
    """Along the path until the load is full; the last point is found at the full load."""
    arc = ArcLength(newton)
    regular = 1.0 / settings.n_steps
    state = arc.start(regular)
    shortest, longest = SMALLEST_STEP * state.length, state.length
    for _ in range(settings.most_points):
        try:
            after = arc.advance(state)
            last = newton.solve(state.at, state.part, 1.0) if after.part >= 1.0 else None
        except NotConvergedError as error:
            state = state.with_length(0.5 * state.length)
            if state.length < shortest:
                raise _gave_up(state.part, error, settings) from error
            continue
        if last is not None:
            yield PathPoint(1.0, last.at, last.reaction, last.iterations, last.residual)
            return
        state = after.with_length(_adapted(after.length, after.iterations, longest))
        yield PathPoint(after.part, after.at, after.reaction, after.iterations, after.residual)
    hint = "fewer n_steps make longer ones" if state.length == longest else "more n_steps may take more points"
    raise ValueError(
        f"nonlinear: after {settings.most_points} points the path is at {state.part:.3g} of the load; {hint}"
    )


def _adapted(step: float, iterations: int, longest: float) -> float:
    if iterations <= EASY:
        return min(step * GROWTH, longest)
    return step / GROWTH if iterations >= HARD else step


def _gave_up(part: float, error: NotConvergedError, settings: PathSettings) -> ValueError:
    hint = (
        "where a shell snaps, control: arc_length follows it"
        if settings.control == "load"
        else f"more n_steps than {settings.n_steps} begin with shorter ones, which lose a path less easily"
    )
    return ValueError(f"nonlinear: no equilibrium was found beyond {part:.4g} of the load ({error}); {hint}")
