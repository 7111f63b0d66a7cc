"""A rough middle line made exact: each point is moved to the middle of the lumen's section across the line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.anatomy.sections import Section, Sectioner
from trocar.services.mechanics.arrays import FloatArray

_PASSES = 4
_SMOOTH_SAMPLES = 1.5
"""Standard deviation of the smoothing along the line, from which tangents are taken."""
_WIDE, _NARROW = 1.3, 0.5
"""Sections beyond these parts of the median about them lie in a fork, or in a rounded end."""
_MEDIAN_SAMPLES = 15


@dataclass(frozen=True)
class Centreline:
    """Points at equal distances along a lumen, with the sections there.

    Attributes:
        points_m: (k, 3) float64.
        sections: One for each point.
    """

    points_m: FloatArray
    sections: list[Section]

    @property
    def at_m(self) -> FloatArray:
        """Arc length (k,) of the points."""
        return arc_length_m(self.points_m)

    @property
    def diameters_m(self) -> FloatArray:
        """Diameters (k,) of circles with the sections' areas."""
        return np.array([section.diameter_m for section in self.sections])


def arc_length_m(points_m: FloatArray) -> FloatArray:
    """Return the length (k,) along points (k, 3)."""
    steps: FloatArray = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resampled(points_m: FloatArray, step_m: float) -> FloatArray:
    """Return points (k, 3) at equal distances of about a step along others, ends kept."""
    at_m = arc_length_m(points_m)
    wanted_m = np.linspace(0.0, at_m[-1], max(4, round(at_m[-1] / step_m) + 1))
    return np.stack([np.interp(wanted_m, at_m, axis) for axis in points_m.T], axis=1)


def centred(rough_m: FloatArray, sectioner: Sectioner, step_m: float) -> Centreline:
    """Return the centreline near a rough one (k, 3); it ends where the lumen closes."""
    points_m = resampled(rough_m, step_m)
    for _ in range(_PASSES):
        points_m = resampled(_smooth(points_m), step_m)
        sections = _sections(points_m, sectioner)
        fit = _fitting(points_m, sections)
        held = np.flatnonzero(fit)
        if len(held) < 2:
            break
        middles = np.array([points_m[k] if section is None else section.middle_m for k, section in enumerate(sections)])
        inner = np.arange(held[0], held[-1] + 1)
        points_m = np.stack([np.interp(inner, held, axis) for axis in middles[held].T], axis=1)
    sections = _sections(points_m, sectioner)
    kept = [k for k, section in enumerate(sections) if section is not None]
    return Centreline(points_m[kept], [section for section in sections if section is not None])


def _smooth(points_m: FloatArray) -> FloatArray:
    """Return points smoothed along the line, without drawing its ends in."""
    smooth = scipy.ndimage.gaussian_filter1d(points_m, 1.0, axis=0, mode="nearest")
    smooth[[0, -1]] = points_m[[0, -1]]
    moved: FloatArray = smooth
    return moved


def tangents(points_m: FloatArray) -> FloatArray:
    """Return unit tangents (k, 3) of a line (k, 3)."""
    padded = np.concatenate([2.0 * points_m[:1] - points_m[3:0:-1], points_m, 2.0 * points_m[-1:] - points_m[-2:-5:-1]])
    smooth = scipy.ndimage.gaussian_filter1d(padded, _SMOOTH_SAMPLES, axis=0)[3:-3]
    along = np.gradient(smooth, axis=0)
    unit: FloatArray = along / np.linalg.norm(along, axis=1, keepdims=True)
    return unit


def _sections(points_m: FloatArray, sectioner: Sectioner) -> list[Section | None]:
    return [sectioner.cut(p, t) for p, t in zip(points_m, tangents(points_m), strict=True)]


def _fitting(points_m: FloatArray, sections: list[Section | None]) -> FloatArray:
    """Return which sections (k,) are the tube's own."""
    areas = np.array([np.nan if section is None else section.area_m2 for section in sections])
    filled = np.where(np.isfinite(areas), areas, np.nanmedian(areas))
    usual = scipy.ndimage.median_filter(filled, min(_MEDIAN_SAMPLES, len(filled)), mode="nearest")
    moved_m = np.array(
        [np.inf if s is None else np.linalg.norm(s.middle_m - p) for s, p in zip(sections, points_m, strict=True)]
    )
    is_near = moved_m < 0.5 * np.sqrt(filled / np.pi)
    fit: FloatArray = np.isfinite(areas) & (areas < _WIDE * usual) & (areas > _NARROW * usual) & is_near
    return fit
