"""What a person would set up round a duct: the mouth, the held ends, the catheter that fits, and the tools' ports."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trocar.services.anatomy.opened_duct import DuctEnd, OpenedDuct
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.services.meshes.errors import MeshError
from trocar.services.messages.nearest_word import did_you_mean

_WHERE_CATHETERS_ENTER = re.compile(r"gall|chole|vesica|mouth|inlet", re.IGNORECASE)
BEFORE_MOUTH_M, INTRODUCER_TO_TIP_M = 6e-3, 65e-3  # as in the default scene
_PORTS_M = ((-23e-3, -60e-3, 120e-3), (-30e-3, 70e-3, 110e-3))
"""Of both tools, as in the default scene: along the way out of the mouth, to its side, and up; the first is counted
from where the catheter is taken."""
_GRIP_M = 32e-3
_TURNS = 24
_CLEAR_M = 6e-3


@dataclass(frozen=True)
class Choice:
    """Which end is the mouth and which are held, by names, and why."""

    mouth: str
    held: tuple[str, ...]
    why: str


def choose_ends(duct: OpenedDuct, mouth: str | None, held: Sequence[str]) -> Choice:
    """Return the choice; an end is said by its name or as x,y,z in millimetres in the patient's LPS axes.

    Raises MeshError if there are fewer than two ends, or no such end.
    """
    if len(duct.ends) < 2:
        raise MeshError(
            f"the duct has one open end, at {_mm(duct.ends[0].opening.centre_m)} mm: a mouth and a held end are needed"
        )
    if mouth is not None:
        chosen, why = find_end(duct, mouth).name, "as said"
    else:
        chosen, why = _mouth(duct)
    kept = tuple(find_end(duct, each).name for each in held) or tuple(e.name for e in duct.ends if e.name != chosen)
    if chosen in kept:
        raise MeshError(f"the end '{chosen}' cannot be the mouth and held")
    return Choice(chosen, kept, why)


def _mouth(duct: OpenedDuct) -> tuple[str, str]:
    for end in duct.ends:
        if _WHERE_CATHETERS_ENTER.search(end.name):
            return end.name, "its name says that the catheter enters there"
    return duct.ends[-1].name, "the narrowest end"


def find_end(duct: OpenedDuct, said: str) -> DuctEnd:
    """Return the end with a name, or that nearest to a place.

    Raises MeshError if there is none; the sentence lists all.
    """
    numbers = said.replace(" ", "").split(",")
    if len(numbers) == 3:
        try:
            place = 1e-3 * np.array([float(number) for number in numbers])
        except ValueError:
            raise MeshError(f"'{said}' is no place x,y,z in millimetres") from None
        return min(duct.ends, key=lambda end: float(np.linalg.norm(end.opening.centre_m - place)))
    for end in duct.ends:
        if said in (end.name, end.opening.name):
            return end
    known = "; ".join(f"{end.name} at {_mm(end.opening.centre_m)} mm" for end in duct.ends)
    near = did_you_mean(said, [end.name for end in duct.ends])
    raise MeshError(f"the duct has no end '{said}'; it has {known}{near}")


def propose_ports(mesh: TriangleMesh) -> list[list[float]]:
    """Return a port (3,) of each tool in the axes of the scene, so that no shaft passes through the duct.

    Above is +z, as far as the mouth's direction allows; where the duct is in the way, the ports are turned round the
    catheter.
    """
    mouth = mouth_opening(mesh)
    out = -mouth.inward
    ports = []
    for (along, side, up), target_m in zip(
        _PORTS_M, (mouth.centre_m + _GRIP_M * out, mouth.centre_m - 12e-3 * out), strict=True
    ):
        start = target_m if up == _PORTS_M[0][2] else mouth.centre_m
        turned = []
        for turn in sorted(np.arange(_TURNS) * 2.0 * np.pi / _TURNS, key=lambda a: min(a, 2.0 * np.pi - a)):
            aside, above = _across(out, float(turn))
            turned.append(start + along * out + side * aside + up * above)
        clear = [_clearance_m(mesh, target_m, port) for port in turned]
        chosen = next(
            (port for port, c in zip(turned, clear, strict=True) if c > _CLEAR_M), turned[int(np.argmax(clear))]
        )
        ports.append([round(float(x), 4) for x in chosen])
    return ports


def _across(out: FloatArray, turn_rad: float) -> tuple[FloatArray, FloatArray]:
    up = np.array([0.0, 0.0, 1.0]) - out[2] * out
    if np.linalg.norm(up) < 0.2:
        up = np.array([0.0, 1.0, 0.0]) - out[1] * out
    up /= np.linalg.norm(up)
    side = np.cross(up, out)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return c * side - s * up, c * up + s * side


def _clearance_m(mesh: TriangleMesh, target_m: FloatArray, port_m: FloatArray) -> float:
    """Return the least distance of a shaft, from 15 mm before its target on, from the duct."""
    along = port_m - target_m
    points = target_m + np.linspace(15e-3 / float(np.linalg.norm(along)), 1.0, 24)[:, None] * along
    return float(np.linalg.norm(mesh.vertices_m[None] - points[:, None], axis=2).min())


def refuse_blocked_catheter(mesh: TriangleMesh) -> None:
    """Refuse a mouth before which the straight catheter would lie in another part of the duct.

    Raises MeshError.
    """
    mouth = mouth_opening(mesh)
    points = mouth.centre_m - np.linspace(2e-3, BEFORE_MOUTH_M + INTRODUCER_TO_TIP_M, 60)[:, None] * mouth.inward
    away = np.linalg.norm(mesh.vertices_m[None] - points[:, None], axis=2)
    rim_m = np.linalg.norm(points - mouth.centre_m, axis=1)[:, None] * 0.6 + 0.0 * away
    blocked = np.argwhere((away < 3e-3) & (away < rim_m))
    if len(blocked):
        at_mm = 1e3 * float(np.linalg.norm(points[blocked[0][0]] - mouth.centre_m))
        raise MeshError(
            f"another part of the duct lies {at_mm:.0f} mm before the mouth, where the catheter comes in: "
            "take another --mouth"
        )


def _mm(place_m: FloatArray) -> list[float]:
    place: list[float] = np.round(1e3 * place_m, 1).tolist()
    return place
