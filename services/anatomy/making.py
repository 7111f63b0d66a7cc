"""From a file of a patient to a folder with a scene that runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from trocar.services.anatomy.centring import arc_length_m
from trocar.services.anatomy.opened_duct import OpenedDuct, open_duct
from trocar.services.anatomy.patient_surface import PatientSurface, of_label, of_surface
from trocar.services.anatomy.proposal import (
    Choice,
    choose_ends,
    find_end,
    propose_ports,
    refuse_blocked_catheter,
)
from trocar.services.anatomy.volume import is_volume
from trocar.services.anatomy.wall import Wall, middle_of_wall, wall_of
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.centreline import centrelines
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.openings import name_ends, place_by_ends, placement

OnStep = Callable[[str], None]
ANTERIOR = (0.0, -1.0, 0.0)
"""Of LPS axes, of which the second points backwards: up, as the patient lies on the back."""


@dataclass(frozen=True)
class AnatomyRequest:
    """What a person says of a file.

    Attributes:
        label, wall: Name or number of the duct's label, and of its wall's; of a volume only.
        unit, axes: Of a surface's coordinates; axes LPS or RAS, None for what the file says.
        is_middle: The surface is the middle of the wall, not that of the lumen.
        thickness_m: Of the wall; None: by the wall's label, or an assumption.
        edge_m: Of the shell's mesh; None: by the narrowest lumen.
        mouth, held: Ends by name, or as x,y,z in mm; None and empty: proposed.
        names: "end=name" for ends that get other names.
        ports_mm: Of each tool, in the patient's LPS axes; empty: proposed.
        goal_mm: A place in the lumen that the catheter's tip is to reach, in LPS axes; None for no goal.
    """

    label: str | None = None
    wall: str | None = None
    unit: str = "mm"
    axes: str | None = None
    is_middle: bool = False
    thickness_m: float | None = None
    edge_m: float | None = None
    mouth: str | None = None
    held: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    ports_mm: tuple[tuple[float, float, float], ...] = ()
    goal_mm: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class TipGoal:
    """Where the catheter's tip is to go: so far along the way from the mouth to an end."""

    end: str
    depth_m: float


@dataclass(frozen=True)
class MadeAnatomy:
    """A duct with all that was chosen, ready to be written.

    Attributes:
        placed: The duct in the scene's axes; its sets are ``clamped``, ``mouth`` and the ends by name.
        origin_m, axes: (3,), (3, 3). A place x in the patient is ``axes @ (x - origin_m)`` in the scene.
        seconds: What each step took.
    """

    path: Path
    request: AnatomyRequest
    surface: PatientSurface
    wall: Wall
    duct: OpenedDuct
    choice: Choice
    placed: TriangleMesh
    origin_m: FloatArray
    axes: FloatArray
    ports_m: list[list[float]]
    goal: TipGoal | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the ends, the widest first."""
        return [end.name for end in self.duct.ends]


def make_anatomy(path: Path, request: AnatomyRequest, on_step: OnStep = lambda step: None) -> MadeAnatomy:
    """Return the duct of a file with a proposal for its scene.

    Raises MeshError if it cannot become one: one sentence with the file, the reason and the place.
    """
    timed = _Timed(on_step)
    timed("reading and smoothing")
    if is_volume(path):
        surface = of_label(path, request.label, request.wall)
    else:
        _refuse_labels(path, request)
        surface = of_surface(path, request.unit, request.axes)
    try:
        return _made(path, request, surface, timed)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error


def _refuse_labels(path: Path, request: AnatomyRequest) -> None:
    if request.label is not None or request.wall is not None:
        raise MeshError(f"{path}: is a surface and has no labels; --label and --wall are a volume's")


def _made(path: Path, request: AnatomyRequest, surface: PatientSurface, timed: _Timed) -> MadeAnatomy:
    timed("measuring the wall")
    wall = wall_of(surface, request.thickness_m)
    closed = surface.mesh if request.is_middle else middle_of_wall(surface.mesh, wall)
    timed("opening the ends")
    duct = open_duct(surface, closed, wall.thickness_m, request.edge_m)
    timed("proposing the scene")
    made = propose(path, request, surface, wall, duct)
    timed("")
    return replace(made, seconds=timed.seconds)


def propose(path: Path, request: AnatomyRequest, surface: PatientSurface, wall: Wall, duct: OpenedDuct) -> MadeAnatomy:
    """Return the duct with the scene that a request and the proposals for what it leaves open make.

    Raises MeshError if they do not go together.
    """
    duct = _renamed(duct, request.names)
    choice = choose_ends(duct, request.mouth, request.held)
    named = name_ends(duct.mesh, choice.held, choice.mouth, [end.name for end in duct.ends])
    origin, axes = placement(named, ANTERIOR)
    placed = place_by_ends(named, ANTERIOR)
    refuse_blocked_catheter(placed)
    ports = [(axes @ (1e-3 * np.array(port) - origin)).round(5).tolist() for port in request.ports_mm]
    goal = None if request.goal_mm is None else _goal(placed, axes @ (1e-3 * np.array(request.goal_mm) - origin))
    return MadeAnatomy(
        path, request, surface, wall, duct, choice, placed, origin, axes, ports or propose_ports(placed), goal
    )


def _goal(placed: TriangleMesh, place_m: FloatArray) -> TipGoal:
    """Return how far along which way from the mouth a place lies."""
    nearest = min(centrelines(placed).items(), key=lambda each: float(np.linalg.norm(each[1] - place_m, axis=1).min()))
    name, way = nearest
    along = arc_length_m(way)
    return TipGoal(name, round(float(along[int(np.linalg.norm(way - place_m, axis=1).argmin())]), 4))


def _renamed(duct: OpenedDuct, names: tuple[str, ...]) -> OpenedDuct:
    ends = list(duct.ends)
    for each in names:
        old, sign, new = each.partition("=")
        if not sign or not new.isidentifier() or new in ("mouth", "clamped"):
            raise MeshError(f"--name {each}: is not END=NAME with a plain word as name")
        k = ends.index(find_end(duct, old))
        if new in [end.name for i, end in enumerate(ends) if i != k]:
            raise MeshError(f"--name {each}: another end is called '{new}'")
        ends[k] = replace(ends[k], name=new, why="as said")
    return replace(duct, ends=ends)


class _Timed:
    """Tells each step as it begins, and keeps what it took."""

    def __init__(self, on_step: OnStep) -> None:
        self._on_step, self._step, self._since = on_step, "", time.monotonic()
        self.seconds: dict[str, float] = {}

    def __call__(self, step: str) -> None:
        now = time.monotonic()
        if self._step:
            self.seconds[self._step] = round(now - self._since, 2)
        self._step, self._since = step, now
        if step:
            self._on_step(step)


def rounded_mm(place_m: FloatArray) -> list[float]:
    """Return a place in millimetres, to a tenth."""
    place: list[float] = np.round(1e3 * np.asarray(place_m), 1).tolist()
    return place
