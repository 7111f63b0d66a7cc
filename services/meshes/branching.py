"""The surface of a branching duct: contoured from the smooth union of its tubes, cut open at its ends, remeshed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.reduction.cache import Entry, fetch
from trocar.services.mechanics.reduction.content_hash import entry_name
from trocar.services.mechanics.surface.branched_tubes import Tube, union_distance_m
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.refining import refine
from trocar.services.meshes.cached import MESH_LIBRARIES, read_entry, write_entry
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.openings import enclosed_volume_m3, find_openings
from trocar.services.meshes.remeshing import remesh

EDGE_OF_RADIUS = 0.4
"""Of the narrowest tube: the edge where a scene names none."""
_CELLS_PER_EDGE = 2.5
_CUT_RADII = 1.5
"""Within so many radii of an end's middle the surface is cut by its plane."""


def load_branching(tubes: list[Tube], edge_m: float | None, cache_dir: Path | None = None) -> TriangleMesh:
    """Return the surface of tubes that leave each other, from the cache if it was made before.

    The first tube is the trunk, whose near end is the set ``mouth``. Each open end has a set with its tube's name, the
    rim; a blind one has its furthest vertices.
    ``edge_m`` is the edge where the tubes are smooth; where they have details it is shorter by as much as those are
    smaller than the narrowest tube's radius.
    Raises MeshError if the tubes touch each other where they do not join, or the edge is too long for them.
    """
    edge_m = edge_m or EDGE_OF_RADIUS * min(tube.detail_m() for tube in tubes)
    libraries = [f"{name} {version(name)}" for name in MESH_LIBRARIES]
    told = [{key: _plain(value) for key, value in dataclasses.asdict(tube).items()} for tube in tubes]
    name = entry_name("mesh", __name__, told, edge_m, libraries)

    def make(entry: Entry) -> None:
        write_entry(entry, branching_mesh(tubes, edge_m))

    return read_entry(fetch(cache_dir or cache_directory(), name, make))


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def branching_mesh(tubes: list[Tube], edge_m: float) -> TriangleMesh:
    """Return the surface, not from the cache; see `load_branching`."""
    ends = _open_ends(tubes)
    surface = _cut(contour_union(tubes, edge_m / _CELLS_PER_EDGE), tubes, ends)
    mesh = remesh(_outward(surface), edge_m)
    if any(tube.has_details for tube in tubes):
        mesh = refine(mesh, _details_m(tubes, edge_m))
    sets, vertices_m = _sets(mesh, tubes, ends), mesh.vertices_m
    for tube in tubes:
        vertices_m = tube.folded_m(vertices_m)
    return TriangleMesh(vertices_m, mesh.triangles, sets)


def _details_m(tubes: list[Tube], edge_m: float) -> Callable[[FloatArray], FloatArray]:
    """Return what gives the edges (n,) at points (n, 3) that details need, if ``edge_m`` is the edge elsewhere."""
    share = edge_m / min(tube.detail_m() for tube in tubes)
    return lambda points_m: share * np.min([tube.details_m(points_m) for tube in tubes], axis=0)


@dataclasses.dataclass(frozen=True)
class _End:
    """An open end: the set's name, the tube that ends, its middle, the unit vector out of it, and its radius."""

    name: str
    tube: Tube
    middle_m: FloatArray
    outward: FloatArray
    radius_m: float


def _open_ends(tubes: list[Tube]) -> list[_End]:
    trunk = tubes[0]
    ends = [_End("mouth", trunk, trunk.origin_m, -trunk.axes[0], trunk.radius_m)]
    for tube in tubes:
        if name := tube.near_opening():
            ends.append(_End(name, tube, tube.origin_m, -tube.axes[0], tube.radius_m))
        if tube.far_end in ("held", "free"):
            middle_m, axes = tube.place(tube.length_m)
            ends.append(_End(tube.name, tube, middle_m, axes[0], tube.end_radius_m))
    return ends


def contour_union(tubes: list[Tube], cell_m: float) -> Any:
    """Return the closed surface of the union."""
    import pyvista

    reach_m = max(max(tube.radius_m, tube.end_radius_m) for tube in tubes) + 2.0 * cell_m
    axis = np.concatenate([[tube.place(at)[0] for at in np.linspace(0.0, tube.length_m, 33)] for tube in tubes])
    low, high = axis.min(axis=0) - reach_m, axis.max(axis=0) + reach_m
    counts = np.ceil((high - low) / cell_m).astype(int) + 1
    grid = pyvista.ImageData(dimensions=counts.tolist(), spacing=(cell_m,) * 3, origin=low.tolist())
    grid["distance_m"] = union_distance_m(tubes, np.asarray(grid.points, dtype=np.float64))
    return grid.contour([0.0], scalars="distance_m", method="flying_edges").clean()


def _cut(surface: Any, tubes: list[Tube], ends: list[_End]) -> Any:
    """Take off the rounded caps beyond the open ends, and nothing of a tube that passes beside an end."""
    for end in ends:
        points_m = np.asarray(surface.points, dtype=np.float64)
        away = points_m - end.middle_m
        is_cap = np.linalg.norm(away, axis=1) < _CUT_RADII * end.radius_m
        near_m = points_m[is_cap]
        own_m = end.tube.distance_m(near_m)
        is_cap[is_cap] = np.all([own_m <= tube.distance_m(near_m) for tube in tubes], axis=0)
        surface["beyond_m"] = np.where(is_cap, away @ end.outward, -end.radius_m)
        surface = surface.clip_scalar(scalars="beyond_m", invert=True, value=0.0)
    return surface.extract_surface(algorithm="dataset_surface").triangulate().clean()


def _outward(surface: Any) -> TriangleMesh:
    mesh = TriangleMesh(np.asarray(surface.points, dtype=np.float64), np.asarray(surface.regular_faces, dtype=np.int32))
    return mesh if enclosed_volume_m3(mesh) > 0.0 else TriangleMesh(mesh.vertices_m, mesh.triangles[:, ::-1])


def _sets(mesh: TriangleMesh, tubes: list[Tube], ends: list[_End]) -> dict[str, IntArray]:
    """Name the rims by the ends that they lie at, and hold those that are to be held."""
    found = find_openings(mesh)
    if len(found) != len(ends):
        raise MeshError(f"the branches give {len(found)} open ends, not {len(ends)}: tubes touch beside their joins")
    sets: dict[str, IntArray] = {}
    for end in ends:
        nearest = min(found, key=lambda opening: float(np.linalg.norm(opening.centre_m - end.middle_m)))
        if np.linalg.norm(nearest.centre_m - end.middle_m) > end.radius_m:
            raise MeshError(f"the branch {end.name!r} has no open end where it should be: it ends in another tube")
        sets[end.name] = nearest.rim
    for tube in tubes:
        if tube.far_end == "blind":
            middle_m, axes = tube.place(tube.length_m)
            tip_m = middle_m + tube.end_radius_m * axes[0]
            away_m = np.linalg.norm(mesh.vertices_m - tip_m, axis=1)
            sets[tube.name] = np.flatnonzero(away_m < 0.7 * tube.end_radius_m).astype(np.int32)
    sets["clamped"] = np.concatenate([sets[name] for tube in tubes if tube.far_end == "held" for name in _held(tube)])
    return sets


def _held(tube: Tube) -> list[str]:
    """Return the names of a tube's ends that are held with its far end."""
    return [tube.name, tube.near_opening()] if tube.near_opening() else [tube.name]
