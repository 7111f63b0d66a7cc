"""Properties of a catheter's segments and joints from the sections of its scene."""

from __future__ import annotations

from typing import Literal

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.scene import CatheterScene

_BEHIND = -1


def softness(scene: CatheterScene) -> FloatArray:
    """Return the ratio (n_segments,) of each segment's modulus to the catheter's own."""
    moduli = [section.youngs_modulus_pa or scene.youngs_modulus_pa for section in scene.sections]
    ratios: FloatArray = np.array([*moduli, scene.youngs_modulus_pa])[_section_of_segments(scene)]
    return ratios / scene.youngs_modulus_pa


def segment_radii(scene: CatheterScene) -> FloatArray:
    """Return outer radii (n_rod_segments,) of segments in m: of the catheter, and of its guide wire beyond the tip."""
    radii_m = np.full(scene.n_rod_segments, 0.5 * scene.outer_diameter_m)
    if scene.guide_wire is not None:
        radii_m[scene.n_segments :] = 0.5 * scene.guide_wire.outer_diameter_m
    return radii_m


def joint_curvature(scene: CatheterScene, name: Literal["rest_curvature_1_m", "steering_1_m_rad"]) -> FloatArray | None:
    """Return (n_segments - 1, 3) of a section key, at joints the mean of both segments; None if no section has it."""
    said = np.array([*(getattr(section, name) for section in scene.sections), (0.0, 0.0, 0.0)])
    if not said.any():
        return None
    per_segment = said[_section_of_segments(scene)]
    means: FloatArray = 0.5 * (per_segment[:-1] + per_segment[1:])
    return means


def _section_of_segments(scene: CatheterScene) -> IntArray:
    """Return the section (n_segments,) that the middle of each segment lies in, -1 behind the last section."""
    ends_m = np.cumsum([section.length_m for section in scene.sections])
    middles_m = (np.arange(scene.n_segments)[::-1] + 0.5) * (scene.length_m / scene.n_segments)
    sections = np.searchsorted(ends_m, middles_m)
    return np.where(sections < len(ends_m), sections, _BEHIND).astype(np.int32)
