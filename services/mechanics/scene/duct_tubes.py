"""The tubes of a scene's branching duct."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.scene.cystic_tubes import cystic_tubes
from trocar.services.mechanics.scene.duct_branch import DuctBranch
from trocar.services.mechanics.scene.scene_model import DuctScene
from trocar.services.mechanics.surface.branched_tubes import Tube, branch_of

TRUNK = "trunk"
_TAKEN = (TRUNK, "mouth", "clamped")


def duct_tubes(duct: DuctScene) -> list[Tube]:
    """Return trunk and branches, parents first; the trunk's near end is the mouth.

    The trunk is placed like the parametric duct: its far end is the origin, which it leaves along +x, bending to +y.
    Raises ValueError that names the key of an inconsistent value.
    """
    if duct.cystic is not None:
        if duct.branches:
            raise ValueError("duct.cystic: brings the common duct with it, and goes with no other branches")
        return cystic_tubes(duct.cystic, duct.thickness_m)
    if duct.cut_angle_rad or duct.slit_length_m:
        raise ValueError("duct: a duct with branches is cut neither obliquely nor open: no cut_angle_rad, no slit")
    goes_on = {branch.parent for branch in duct.branches if branch.at_m is None}
    tubes = {TRUNK: _trunk(duct, "on" if TRUNK in goes_on else "held")}
    for k, branch in enumerate(duct.branches):
        if fault := _fault(branch, tubes):
            raise ValueError(f"duct.branches.{k}.{fault}")
        tubes[branch.name] = _tube(branch, tubes[branch.parent], "on" if branch.name in goes_on else branch.end)
    if not any(tube.far_end == "held" for tube in tubes.values()):
        raise ValueError("duct.branches: no end is held, and the duct would float")
    return list(tubes.values())


def _trunk(duct: DuctScene, far_end: str) -> Tube:
    """Return the trunk, from the mouth to its far end."""
    k, angle = duct.curvature_1_m, duct.curvature_1_m * duct.length_m
    to_mouth, aside = (
        np.array([math.cos(angle), math.sin(angle), 0.0]),
        np.array([-math.sin(angle), math.cos(angle), 0]),
    )
    mouth_m = np.array([math.sin(angle), 1.0 - math.cos(angle), 0.0]) / k if k else duct.length_m * to_mouth
    axes = np.stack([-to_mouth, aside, np.cross(-to_mouth, aside)])
    return Tube(TRUNK, mouth_m, axes, duct.length_m, duct.radius_m * (1.0 - duct.taper), duct.radius_m, k, far_end)


def _tube(branch: DuctBranch, parent: Tube, far_end: str) -> Tube:
    at_m = parent.length_m if branch.at_m is None else branch.at_m
    origin_m, axes = branch_of(parent, at_m, branch.angle_rad, branch.azimuth_rad)
    radii_m = branch.radius_m, branch.radius_m * (1.0 - branch.taper)
    return Tube(branch.name, origin_m, axes, branch.length_m, *radii_m, branch.curvature_1_m, far_end)


def _fault(branch: DuctBranch, tubes: dict[str, Tube]) -> str:
    """Return the error message of an invalid branch, with its key; empty if it is valid."""
    if branch.name in tubes or branch.name in _TAKEN or not branch.name.isidentifier():
        return f"name: {branch.name!r} is taken, or no plain word"
    if branch.parent not in tubes:
        return f"parent: {branch.parent!r} is none of the tubes above it: {', '.join(tubes)}"
    parent = tubes[branch.parent]
    for key in ("radius_m", "length_m"):
        if not getattr(branch, key) > 0.0:
            return f"{key}: must be positive, is {getattr(branch, key)}"
    if not 0.0 <= branch.taper < 1.0:
        return f"taper: must be at least 0 and below 1, is {branch.taper}"
    if branch.at_m is not None and not 0.0 < branch.at_m < parent.length_m:
        return f"at_m: must lie between 0 and {parent.length_m:g}, the length of {branch.parent!r}, is {branch.at_m:g}"
    if branch.radius_m > 1.01 * parent.radius_at(parent.length_m if branch.at_m is None else branch.at_m):
        return f"radius_m: is wider than {branch.parent!r}, which it leaves"
    if abs(branch.curvature_1_m) * branch.radius_m >= 1.0:
        return "curvature_1_m: folds the wall onto itself, it must be below 1 / radius_m"
    return ""
