"""Whether a scene's catheter and guide wire can bend as their sections say, and their segments can show it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.scene import SceneModel

MOST_TURN_RAD = 0.48
"""Of one segment at rest. A bend of segments with the length l and the turn t reaches too far aside, by t^2 / 24."""


@dataclass(frozen=True)
class _Bend:
    """A curvature of a section at rest."""

    key: str
    curvature_1_m: tuple[float, float, float]
    radius_m: float
    whose: str

    @property
    def across_1_m(self) -> float:
        """Return the curvature of the centreline, without twist."""
        return math.hypot(*self.curvature_1_m[:2])


def bend_fault(scene: SceneModel) -> str:
    """Return what is wrong with the first bend that cannot be, with its key; empty for nothing."""
    catheter = scene.catheter
    segment_m = catheter.length_m / catheter.n_segments
    for bend in _bends(scene):
        if bend.across_1_m * bend.radius_m > 1.0:
            return (
                f"{bend.key}: bends to a radius of {1e3 / bend.across_1_m:.3g} mm, below the {bend.whose}'s own of "
                f"{1e3 * bend.radius_m:.3g} mm"
            )
        turn_rad = segment_m * math.hypot(*bend.curvature_1_m) if bend.across_1_m else 0.0
        if turn_rad > MOST_TURN_RAD:
            needed = math.ceil(catheter.n_segments * turn_rad / MOST_TURN_RAD)
            return (
                f"catheter.n_segments: {catheter.n_segments} are too few for {bend.key}, which turns by "
                f"{turn_rad:.2g} rad along one of {1e3 * segment_m:.3g} mm; {needed} keep its shape to 1 %"
            )
    return ""


def _bends(scene: SceneModel) -> Iterator[_Bend]:
    """Yield the curvatures at rest of a scene, with the handle that steers the catheter at both ends of its way."""
    catheter, wire = scene.catheter, scene.catheter.guide_wire
    handle_rad = max((tool.handle_range[1] for tool in scene.forceps if tool.drives_catheter), default=0.0)
    radius_m = 0.5 * catheter.outer_diameter_m
    for k, section in enumerate(catheter.sections):
        own = np.array(section.rest_curvature_1_m)
        for key, at_rad in (("rest_curvature_1_m", 0.0), ("steering_1_m_rad", handle_rad)):
            x, y, z = (own + at_rad * np.array(section.steering_1_m_rad)).tolist()
            yield _Bend(f"catheter.sections.{k}.{key}", (x, y, z), radius_m, "catheter")
    for k, section in enumerate(wire.sections if wire else ()):
        assert wire is not None
        key = f"catheter.guide_wire.sections.{k}.rest_curvature_1_m"
        yield _Bend(key, section.rest_curvature_1_m, 0.5 * wire.outer_diameter_m, "wire")
