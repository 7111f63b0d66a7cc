"""A closed surface made a duct: centreline, ends cut open square to it, even triangles, ends with names."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.anatomy.catheter_choice import fitting_catheter
from trocar.services.anatomy.centring import Centreline, centred
from trocar.services.anatomy.cutting import Cut, cut_open, find_cut, judge_tube
from trocar.services.anatomy.patient_surface import PatientSurface, distances_m
from trocar.services.anatomy.sections import Sectioner
from trocar.services.anatomy.tips import Way, ways_between_tips
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene.mesh_cells import MOST_NODES_ALL_PAIRS
from trocar.services.mechanics.surface.mesh import TriangleMesh, triangle_areas_m2
from trocar.services.meshes.branching import EDGE_OF_RADIUS
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.openings import SurfaceOpening, enclosed_volume_m3, find_openings
from trocar.services.meshes.remeshing import remesh

_ROUGH_EDGE, _STEP = 0.45, 0.4
"""Of the mean radius: edges of the surface on which tips are sought, and steps along a centreline."""
_LEAST_VOXELS = 2.0
"""Width of a lumen, in voxels, below which its shape is not known."""
_BESIDE_VOXELS = 3.0
_BORDER_VOXELS = 2.0


@dataclass(frozen=True)
class DuctEnd:
    """An open end of a duct in the patient.

    Attributes:
        name: A plain word.
        opening: Its rim, in the duct's mesh.
        why: Where the name is from.
    """

    name: str
    opening: SurfaceOpening
    why: str


@dataclass(frozen=True)
class OpenedDuct:
    """A duct that a shell can be made of, in the patient's axes.

    Attributes:
        mesh: Even triangles; open at ``ends``.
        ends: The widest first.
        lines: The centrelines from one end to each other, between the cuts, of the surface before it was remeshed.
        edge_m: Length of an edge of the mesh.
        catheter: The widest that passes.
        moved_m: (95 %, greatest) distance of the mesh from the smooth surface.
    """

    mesh: TriangleMesh
    ends: list[DuctEnd]
    lines: list[Centreline]
    edge_m: float
    catheter: str
    moved_m: tuple[float, float]


def open_duct(surface: PatientSurface, closed: TriangleMesh, thickness_m: float, edge_m: float | None) -> OpenedDuct:
    """Return the duct inside a closed surface: ``closed``, that of the file moved to the middle of the wall.

    Raises MeshError if it is no tree of tubes with two ends or more; the sentence names the place.
    """
    radius_m = 2.0 * enclosed_volume_m3(closed) / float(triangle_areas_m2(closed).sum())
    ways = ways_between_tips(remesh(closed, _ROUGH_EDGE * radius_m))
    sectioner = Sectioner(closed)
    lines = [centred(way.points_m, sectioner, _STEP * radius_m) for way in ways]
    cuts = _cuts(ways, lines, sectioner)
    judge_tube(lines[0], cuts[0], cuts[1])
    opened = cut_open(closed, cuts)
    _refuse_cut_side(surface, opened, cuts)
    between = [_between(line, cuts[0], cut) for line, cut in zip(lines, cuts[1:], strict=True)]
    _refuse_thin(surface, between)
    catheter = fitting_catheter(between, thickness_m)
    edge_m = edge_m or shell_edge_m(opened, between)
    mesh = remesh(opened, edge_m)
    moved_m = distances_m(opened, mesh.vertices_m)
    ends = _named_ends(surface, mesh, cuts)
    return OpenedDuct(
        mesh, ends, between, edge_m, catheter, (float(np.percentile(moved_m, 95.0)), float(moved_m.max()))
    )


def _cuts(ways: list[Way], lines: list[Centreline], sectioner: Sectioner) -> list[Cut]:
    """Return the cut of the tip that all ways begin at, and then that of each way's other tip."""
    cuts = [find_cut(lines[0], ways[0].tips_m[0], sectioner)]
    for way, line in zip(ways, lines, strict=True):
        cuts.append(find_cut(Centreline(line.points_m[::-1], line.sections[::-1]), way.tips_m[1], sectioner))
    return cuts


def _between(line: Centreline, first: Cut, last: Cut) -> Centreline:
    at_m = line.at_m
    kept = np.flatnonzero((at_m >= first.length_m) & (at_m <= at_m[-1] - last.length_m))
    points_m = line.points_m[kept]
    points_m[[0, -1]] = first.middle_m, last.middle_m
    return Centreline(points_m, [line.sections[k] for k in kept])


def shell_edge_m(opened: TriangleMesh, lines: list[Centreline]) -> float:
    """Return the edge for a shell: short for the narrowest lumen, and not so short that the mesh gets too large."""
    narrow_m = 0.5 * min(float(np.percentile(line.diameters_m, 5.0)) for line in lines)
    least_m = float(np.sqrt(2.0 / np.sqrt(3.0) * triangle_areas_m2(opened).sum() / MOST_NODES_ALL_PAIRS))
    return max(EDGE_OF_RADIUS * narrow_m, least_m)


def _refuse_thin(surface: PatientSurface, lines: list[Centreline]) -> None:
    if surface.volume is None:
        return
    voxel_m = float(np.cbrt(surface.volume.spacing_m.prod()))
    for line in lines:
        k = int(np.argmin(line.diameters_m))
        if (width_m := float(line.diameters_m[k])) < _LEAST_VOXELS * voxel_m:
            raise MeshError(
                f"the duct is {1e3 * width_m:.2g} mm wide round {_mm(line.points_m[k])} mm, less than "
                f"{_LEAST_VOXELS:g} voxels: its shape there is not known, resample the scan finer"
            )


def _refuse_cut_side(surface: PatientSurface, opened: TriangleMesh, cuts: list[Cut]) -> None:
    """Refuse a label that the volume's border cuts off beside its ends."""
    volume = surface.volume
    if volume is None or surface.mask is None:
        return
    at = np.argwhere(volume.at_border() & surface.mask)
    if not len(at):
        return
    places, reach_m = volume.place_m(at), _BORDER_VOXELS * float(volume.spacing_m.max())
    near = np.asarray(scipy.spatial.KDTree(opened.vertices_m).query(places)[0]) < reach_m
    for cut in cuts:
        near &= (places - cut.middle_m) @ cut.outward < -reach_m
    if near.any():
        raise MeshError(
            f"label '{volume.label}' is cut off lengthwise by the border of the volume round "
            f"{_mm(places[near].mean(axis=0))} mm: scan or crop farther out"
        )


def _named_ends(surface: PatientSurface, mesh: TriangleMesh, cuts: list[Cut]) -> list[DuctEnd]:
    found = find_openings(mesh)
    if len(found) != len(cuts):
        raise MeshError(f"{len(cuts)} ends were cut open, and the surface has {len(found)}: give a shorter --edge-mm")
    ends: list[DuctEnd] = []
    for opening in found:
        cut = min(cuts, key=lambda c: float(np.linalg.norm(c.middle_m - opening.centre_m)))
        name, why = _name_beside(surface, cut)
        taken = [end.name for end in ends]
        word = name if name and name not in taken else opening.name
        ends.append(DuctEnd(word, opening, why if word == name else "by its width, the widest is end_0"))
    return ends


def _name_beside(surface: PatientSurface, cut: Cut) -> tuple[str, str]:
    """Return the name of the segment that an end borders on, as a plain word; empty if there is none."""
    volume = surface.volume
    if volume is None or surface.mask is None:
        return "", ""
    filled = np.argwhere(volume.beside > 0)
    if not len(filled):
        return "", ""
    places = volume.place_m(filled)
    voxel_m = float(volume.spacing_m.max())
    off, nearest = _distance_from_end(places, cut), volume.beside[tuple(filled.T)]
    near = off < _BESIDE_VOXELS * voxel_m + 0.5 * cut.diameter_m
    if not near.any():
        return "", ""
    name = volume.names[int(np.bincount(nearest[near]).argmax())]
    return plain_word(name), f"borders on the segment '{name}'"


def _distance_from_end(places_m: FloatArray, cut: Cut) -> FloatArray:
    """Return the distance (n,) of places from the tip that was cut off; far for those on the duct's side of the cut."""
    beyond = (places_m - cut.middle_m) @ cut.outward
    off: FloatArray = np.where(beyond > 0.0, np.linalg.norm(places_m - cut.tip_m, axis=1), np.inf)
    return off


def plain_word(name: str) -> str:
    """Return a name as a word that a scene's keys may have."""
    word = re.sub(r"\W+", "_", name.strip().lower()).strip("_")
    return word if word.isidentifier() and word not in ("mouth", "clamped") else f"end_{word}".rstrip("_")


def _mm(place_m: FloatArray) -> list[float]:
    place: list[float] = np.round(1e3 * place_m, 1).tolist()
    return place
