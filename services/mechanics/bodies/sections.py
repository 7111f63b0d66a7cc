"""Properties of a catheter's segments and joints from the sections of its scene.

A section ends where it is said to end, also within a segment. Between two particles a property of the rod belongs to
both of them, to each in proportion to its linear shape function. A joint has the integrals of compliance and of rest
curvature with the shape function of its particle. So the turn of all joints, and its first moment, do not change with
the number of segments: a bent section moves the tip aside as far as its arc does, as long as a segment turns little.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene import CatheterScene


def end_softness(scene: CatheterScene) -> FloatArray:
    """Return the ratio (n_segments, 2) of the modulus at both ends of each segment to the catheter's own."""
    moduli = [section.youngs_modulus_pa or scene.youngs_modulus_pa for section in scene.sections]
    compliance = scene.youngs_modulus_pa / np.array([*moduli, scene.youngs_modulus_pa])
    ratios: FloatArray = 1.0 / (_shares(scene) @ compliance)
    return ratios


def axial_softness(scene: CatheterScene) -> FloatArray:
    """Return the ratio (n_segments,) of each segment's axial stiffness to the catheter's own: pieces in series."""
    ratios: FloatArray = 1.0 / np.mean(1.0 / end_softness(scene), axis=1)
    return ratios


def segment_radii(scene: CatheterScene) -> FloatArray:
    """Return outer radii (n_rod_segments,) of segments in m: of the catheter, and of its guide wire beyond the tip."""
    radii_m = np.full(scene.n_rod_segments, 0.5 * scene.outer_diameter_m)
    if scene.guide_wire is not None:
        radii_m[scene.n_segments :] = 0.5 * scene.guide_wire.outer_diameter_m
    return radii_m


def joint_curvature(scene: CatheterScene, name: Literal["rest_curvature_1_m", "steering_1_m_rad"]) -> FloatArray | None:
    """Return (n_segments - 1, 3) of a section key, weighted means at the joints; None if no section has it."""
    said = np.array([*(getattr(section, name) for section in scene.sections), (0.0, 0.0, 0.0)])
    if not said.any():
        return None
    at_ends = _shares(scene) @ said
    means: FloatArray = 0.5 * (at_ends[:-1, 1] + at_ends[1:, 0])
    return means


def _shares(scene: CatheterScene) -> FloatArray:
    """Return shares (n_segments, 2, sections + 1) of sections in each segment, weighted by its ends' shape functions.

    The last section is what lies behind those of the scene. The shares of each end have the sum 1.
    """
    segment_m = scene.length_m / scene.n_segments
    from_tip_m = segment_m * np.arange(scene.n_segments)[::-1]
    ends_m = np.cumsum([0.0, *(section.length_m for section in scene.sections)])
    reached = np.clip((ends_m - from_tip_m[:, None]) / segment_m, 0.0, 1.0)
    reached = np.column_stack([reached, np.ones(scene.n_segments)])
    shares: FloatArray = np.diff(np.stack([reached**2, reached * (2.0 - reached)], axis=1), axis=2)
    return shares
