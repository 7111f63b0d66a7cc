"""From a surface file to a duct mesh that a model accepts: read, repair, remesh, scale, name the ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trocar.services.mechanics.surface.mesh import TriangleMesh, smallest_angles_rad
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.openings import SurfaceOpening, lumen_diameter_m, name_ends, named_openings, place_by_ends
from trocar.services.meshes.plausibility import judge_size, judge_unit
from trocar.services.meshes.reading import read_surface
from trocar.services.meshes.remeshing import remesh
from trocar.services.meshes.repairing import repair_surface

SLIVER_ANGLE_RAD = np.radians(1.0)
"""A surface with a sharper triangle is not solved as it stands: its stiffness would swamp its neighbours'."""


@dataclass(frozen=True)
class SurfaceSettings:
    """How a file becomes a duct."""

    units: str
    """Unit of length in the file."""
    clamped: tuple[str, ...] = ("end_0",)
    """Open ends that are held; ``end_0`` is the widest."""
    mouth: str = "end_1"
    """Open end that the catheter enters."""
    edge_m: float | None = None
    """Edge length to remesh to, after scaling; none keeps the file's triangles."""
    lumen_diameter_m: float | None = None
    """Scale the surface so that its lumen near the widest end has this diameter; none keeps its size."""
    names: tuple[str, ...] = ()
    """Names of the open ends, the widest first; none: ``end_0``, ``end_1`` and so on."""
    up: tuple[float, float, float] | None = None
    """What is up in the file's axes: z of the scene, as near as the mouth's direction allows."""


@dataclass(frozen=True)
class DuctSurface:
    """A duct from a file, with what was done to it and what it has."""

    mesh: TriangleMesh
    openings: list[SurfaceOpening]
    actions: list[str]


OnStep = Callable[[str], None]
"""Told what is begun: reading, repairing, remeshing."""


def _silent(step: str) -> None:
    """Follow nothing."""


def load_duct_surface(path: Path, settings: SurfaceSettings, on_step: OnStep = _silent) -> DuctSurface:
    """Load any triangle surface file as a duct; its clamped end is put at the origin and its mouth on +x.

    Raises MeshError if the surface cannot be used; the sentence names the file, the reason and the place.
    """
    on_step("reading")
    read: list[str] = []
    raw = read_surface(path, settings.units, read)
    try:
        if settings.lumen_diameter_m is None:
            judge_unit(raw, settings.units)
        if settings.edge_m is None:
            judge_size(raw)
        duct = _make_duct(raw, settings, on_step)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error
    return DuctSurface(duct.mesh, duct.openings, [*read, *duct.actions])


def _make_duct(raw: TriangleMesh, settings: SurfaceSettings, on_step: OnStep) -> DuctSurface:
    """Scaling comes last, so that places in messages are those of the file."""
    on_step("repairing")
    repaired = repair_surface(raw, is_used=settings.edge_m is None)
    mesh, actions = repaired.mesh, list(repaired.actions)
    factor = 1.0 if settings.lumen_diameter_m is None else _lumen_factor(mesh, settings.lumen_diameter_m)
    if settings.edge_m is not None:
        on_step("remeshing")
        mesh = remesh(mesh, settings.edge_m / factor)
        actions.append(f"remeshed from {repaired.mesh.n_triangles} to {mesh.n_triangles} triangles")
    _refuse_slivers(mesh)
    mesh = name_ends(mesh, settings.clamped, settings.mouth, settings.names)
    if factor != 1.0:
        actions.append(f"scaled by {factor:.4g}")
    mesh = place_by_ends(TriangleMesh(factor * mesh.vertices_m, mesh.triangles, mesh.vertex_sets), settings.up)
    return DuctSurface(mesh, named_openings(mesh, settings.names), actions)


def _lumen_factor(mesh: TriangleMesh, wanted_m: float) -> float:
    if not wanted_m > 0.0:
        raise MeshError(f"lumen_diameter_m must be positive, is {wanted_m}")
    return wanted_m / lumen_diameter_m(mesh)


def _refuse_slivers(mesh: TriangleMesh) -> None:
    angles = smallest_angles_rad(mesh)
    sharpest = int(np.argmin(angles))
    if angles[sharpest] < SLIVER_ANGLE_RAD:
        place_mm = np.round(1e3 * mesh.vertices_m[mesh.triangles[sharpest]].mean(axis=0), 2).tolist()
        raise MeshError(
            f"triangle {sharpest} at {place_mm} mm has an angle of {np.degrees(angles[sharpest]):.2g}°; "
            "give edge_m to remesh"
        )
