"""Which numbers of a scene must be above zero, and which may be zero but not below: a length, say, or a damping.

The mechanics takes plain data; much of it would compute with a negative radius without a word.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Sequence
from typing import Any

from trocar.services.mechanics.scene import CatheterScene, QualityLevel, SceneModel, ToolScene
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.scenes.bends import bend_fault

_POSITIVE = {
    "duct": "radius_m length_m n_around n_along thickness_m youngs_modulus_pa density_kg_m3 n_modes mesh_edge_m "
    "mesh_lumen_diameter_m",
    "guide_wire": "outer_diameter_m youngs_modulus_pa density_kg_m3 out_m least_out_m reach_m",
    "section": "length_m youngs_modulus_pa",
    "bubble": "radius_m",
    "catheter": "n_segments length_m outer_diameter_m youngs_modulus_pa density_kg_m3 introducer_length_m",
    "contact": "tolerance_n capacity penalty_stiffness_n_m",
    "quality": "iterations ticks_per_step cost_us",
}
_NOT_NEGATIVE = {
    "duct": "slit_length_m slit_width_m damping_ratio traction_n",
    "catheter": "inner_diameter_m before_mouth_m internal_damping_s viscous_drag_n_s_m2 introducer_to_tip_m "
    "introducer_friction introducer_seal_friction_n spectral_radius",
    "guide_wire": "friction",
    "bubble": "after_m3",
    "contact": "margin_m recovery penalty_damping_n_s_m",
    "quality": "force_error_percent motion_error_percent",
}
MOST_RUNGS = 16
"""As many as the wire can name."""
_AT_MOST: dict[str, dict[str, float]] = {
    # A step with so many modes takes longer than a millisecond, and finding more takes many minutes.
    "duct": {"n_modes": 2000, "length_m": 2.0},
    "catheter": {"spectral_radius": 1.0, "n_segments": 1000},
    "contact": {"recovery": 1.0, "capacity": 1000},  # the matrix of all contacts is dense: 72 MB
    "quality": {"ticks_per_step": 2},  # what moves the hand is stale after five
}
LARGEST = 1e30
"""Of any number: the mechanics multiplies several, and beyond 1e308 a product is infinite."""
LENGTH_MAX_M = 10.0
"""Of any length and place: a patient is below 3 m, and what is in millimetres is a thousand times as long."""
_OF_LENGTH = re.compile(r"(?<!_[1ns])_m(\.\d)?$")
"""What ends a length's name: not that of a curvature (1_m), a stiffness (n_m) or a damping (n_s_m)."""


def fault(scene: SceneModel) -> str:
    """Return what is wrong with the first number that is out of its bounds, with its key; empty for nothing."""
    for part, path, holder in _parts(scene):
        positive, not_negative = _bounded(part, holder)
        for names, lowest, wanted in ((positive, 0.0, "be positive"), (not_negative, -5e-324, "not be negative")):
            for name in names:
                value = getattr(holder, name)
                if value is not None and not value > lowest:
                    return f"{path}.{name}: must {wanted}, is {value}"
        for name, most in _AT_MOST.get(part, {}).items():
            if getattr(holder, name) > most:
                return f"{path}.{name}: must not be above {most:g}, is {getattr(holder, name)}"
        for name, value in _floats(holder):
            if abs(value) > LARGEST:
                return f"{path}.{name}: must not be above {LARGEST:g} in size, is {value:g}"
            if abs(value) > LENGTH_MAX_M and _OF_LENGTH.search(name):
                return f"{path}.{name}: must not be above {LENGTH_MAX_M:g} m, is {value:g}; is it in another unit?"
    if not len(scene.forceps) <= N_TOOLS:
        return f"forceps: at most {N_TOOLS}, are {len(scene.forceps)}"
    if sum(tool.drives_catheter for tool in scene.forceps) > 1:
        return "forceps: one drive holds the catheter's end, are 2"
    if sum(tool.drives_wire for tool in scene.forceps) != (scene.catheter.guide_wire is not None):
        return "catheter.guide_wire: goes with one tool of kind wire_drive, and that with it"
    return _hands_fault(scene) or _catheter_fault(scene.catheter) or bend_fault(scene) or _ladder_fault(scene.quality)


def _bounded(part: str, holder: Any) -> tuple[Sequence[str], Sequence[str]]:
    """Return which numbers of a part must be positive, and which not negative: a tool's kind says so itself."""
    if isinstance(holder, ToolScene):
        return holder.positive, holder.not_negative
    return _POSITIVE.get(part, "").split(), _NOT_NEGATIVE.get(part, "").split()


def _hands_fault(scene: SceneModel) -> str:
    """Return what keeps a scene's hands from what they are for: the tool that inserts or pinches needs jaws."""
    if scene.forceps and scene.hands == "drive" and not any(tool.drives_catheter for tool in scene.forceps):
        return "hands: drive needs a tool of kind drive"
    if not scene.forceps or scene.hands not in ("insertion", "pinch"):
        return ""
    at = 0 if scene.hands == "insertion" else len(scene.forceps) - 1
    if scene.forceps[at].jaws is not None:
        return ""
    return f"hands: {scene.hands} needs jaws, and forceps.{at} is a {scene.forceps[at].kind}; press does without"


def _catheter_fault(catheter: CatheterScene) -> str:
    """Return what of a catheter does not go together."""
    if not any(catheter.direction):
        return "catheter.direction: must not be zero"
    if wrong := _wire_fault(catheter):
        return wrong
    if (sections_m := sum(section.length_m for section in catheter.sections)) > catheter.length_m:
        return f"catheter.sections: are {sections_m:g} m long together, the catheter {catheter.length_m:g} m"
    if not -1.0 < catheter.poisson_ratio <= 0.5:
        return f"catheter.poisson_ratio: must lie above -1 and not above 0.5, is {catheter.poisson_ratio}"
    if not catheter.inner_diameter_m < catheter.outer_diameter_m:
        return (
            f"catheter.inner_diameter_m: must be below outer_diameter_m, {catheter.outer_diameter_m}, is "
            f"{catheter.inner_diameter_m}"
        )
    return ""


def _wire_fault(catheter: CatheterScene) -> str:
    """Return what of a guide wire does not go together, or not into its catheter."""
    path, wire = "catheter.guide_wire", catheter.guide_wire
    if wire is None:
        return ""
    if not wire.outer_diameter_m < catheter.inner_diameter_m:
        return (
            f"{path}.outer_diameter_m: must be below the catheter's inner_diameter_m, {catheter.inner_diameter_m}, is "
            f"{wire.outer_diameter_m}"
        )
    if not -1.0 < wire.poisson_ratio <= 0.5:
        return f"{path}.poisson_ratio: must lie above -1 and not above 0.5, is {wire.poisson_ratio}"
    if not wire.least_out_m <= wire.out_m <= wire.reach_m < catheter.length_m:
        return (
            f"{path}.out_m: must lie within least_out_m and reach_m, that below the catheter's length, is {wire.out_m}"
        )
    for k, section in enumerate(wire.sections):
        if any(section.steering_1_m_rad) or section.rest_curvature_1_m[2]:
            return f"{path}.sections.{k}: a wire is neither steered nor twisted at rest"
    return ""


def _floats(holder: Any) -> Iterator[tuple[str, float]]:
    """Yield each number of a part of a scene, and each of a vector, with its key."""
    for field in dataclasses.fields(holder) if dataclasses.is_dataclass(holder) else ():
        value = getattr(holder, field.name)
        for index, each in enumerate(value) if isinstance(value, tuple) else [(None, value)]:
            if isinstance(each, float):
                yield field.name if index is None else f"{field.name}.{index}", each


def _ladder_fault(ladder: Sequence[QualityLevel]) -> str:
    """Return what is wrong with the rungs beside each other."""
    if not 1 <= len(ladder) <= MOST_RUNGS:
        return f"quality: needs one to {MOST_RUNGS} rungs, has {len(ladder)}"
    for k, level in enumerate(ladder):
        if level.name in (other.name for other in ladder[:k]):
            return f"quality.{k}.name: there is a rung {level.name!r} above"
        if (level.cost_us is None) != (ladder[0].cost_us is None):
            return f"quality.{k}.cost_us: was measured either for every rung or for none"
        if k and level.cost_us is not None and not level.cost_us < (ladder[k - 1].cost_us or 0.0):
            return f"quality.{k}.cost_us: must be less than that of the rung above, is {level.cost_us:g}"
    return ""


def _parts(scene: SceneModel) -> Iterator[tuple[str, str, Any]]:
    """Yield each part of a scene with its key: the parts of a list one by one."""
    for field in dataclasses.fields(scene):
        value = getattr(scene, field.name)
        for index, each in enumerate(value) if isinstance(value, tuple) else [(None, value)]:
            yield field.name, field.name if index is None else f"{field.name}.{index}", each
    wire = scene.catheter.guide_wire
    if wire is not None:
        yield "guide_wire", "catheter.guide_wire", wire
    for path, sections in (
        ("catheter", scene.catheter.sections),
        ("catheter.guide_wire", wire.sections if wire else ()),
    ):
        for k, section in enumerate(sections):
            yield "section", f"{path}.sections.{k}", section
    for k, bubble in enumerate(scene.catheter.bubbles):
        yield "bubble", f"catheter.bubbles.{k}", bubble
