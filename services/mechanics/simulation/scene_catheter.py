"""Builds a scene's catheter: material with effects, supports and placement."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from trocar.services.mechanics.bodies.catheter import rod_properties, rod_supports
from trocar.services.mechanics.bodies.guide_wire import with_wire
from trocar.services.mechanics.effects import Effect, build_effects, by_stage
from trocar.services.mechanics.rod import RodProperties
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.instruments.drive import FromBehind
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.opening import mouth_opening

_OF_ONE_TUBE = "gravity", "mucus_drag", "self_contact"
"""Effects that assume that every segment is one of the catheter's."""


def scene_rod(scene: SceneModel, effects: Iterable[Effect]) -> RodProperties:
    """Return stiffness, mass and damping of a scene's catheter; ``effects`` are those that modify it, in order.

    Raises ValueError: the scene's values make no valid rod.
    """
    try:
        rod = rod_properties(scene.catheter)
        for effect in effects:
            rod = effect.modify_rod(rod)
    except ValueError as error:
        raise ValueError(f"catheter: {error}") from None
    _check_wire(scene, rod)
    if rod.torsional_stiffness_n_m2 is None and (key := _turns_with_material(scene)):
        raise ValueError(f"{key}: turns with the material, name the effect 'twist' too")
    wire = scene.catheter.guide_wire
    return rod if wire is None else with_wire(rod, wire, scene.catheter.n_wire_segments)


def _check_wire(scene: SceneModel, rod: RodProperties) -> None:
    """Raises ValueError: other settings of the scene do not fit its guide wire."""
    catheter = scene.catheter
    if catheter.guide_wire is None:
        return
    if rod.torsional_stiffness_n_m2 is None:
        raise ValueError("catheter.guide_wire: turns in the catheter, name the effect 'twist' too")
    if catheter.anchor != "introducer" or catheter.integrator != "implicit":
        raise ValueError("catheter.guide_wire: needs a catheter with anchor introducer and integrator implicit")
    if blind := [name for name in _OF_ONE_TUBE if name in scene.effects]:
        raise ValueError(f"catheter.guide_wire: the effect {blind[0]!r} knows a catheter alone, leave one of both out")


def _turns_with_material(scene: SceneModel) -> str:
    """Return the first key of a scene's catheter that needs a material frame; empty for none."""
    if scene.catheter.rest_curvature_1_m:
        return "catheter.rest_curvature_1_m"
    for k, section in enumerate(scene.catheter.sections):
        for name in ("rest_curvature_1_m", "steering_1_m_rad"):
            if any(getattr(section, name)):
                return f"catheter.sections.{k}.{name}"
    return ""


def place_catheter(scene: SceneModel, mesh: TriangleMesh) -> SceneModel:
    """Return the scene with its catheter in the start position: before an opening of this duct, if so specified.

    A drive is placed behind the catheter's proximal end, on its axis.
    """
    catheter = scene.catheter
    if catheter.before_mouth_m is not None:
        mouth = mouth_opening(mesh, catheter.opening)
        tip_m = mouth.centre_m - catheter.before_mouth_m * mouth.inward
        (x, y, z), (a, b, c) = tip_m.tolist(), mouth.inward.tolist()
        catheter = replace(catheter, tip_position_m=(x, y, z), direction=(a, b, c), before_mouth_m=None)
    behind = np.array(catheter.direction) / -float(np.linalg.norm(catheter.direction))
    end_m = np.array(catheter.tip_position_m) + catheter.length_m * behind
    tools = tuple(
        replace(tool, port_position_m=tuple((end_m + tool.behind_m * behind).tolist()))
        if isinstance(tool, FromBehind) else tool for tool in scene.forceps
    )  # fmt: skip
    return replace(scene, catheter=catheter, forceps=tools)


def check_catheter(scene: SceneModel) -> None:
    """Check early that the catheter can be built.

    Raises ValueError: its values make no valid rod, or it does not start in its introducer.
    """
    scene_rod(scene, by_stage(build_effects(scene).values())["modify_rod"])
    rod_supports(scene.catheter)
