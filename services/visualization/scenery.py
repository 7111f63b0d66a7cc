"""Scenery behind the duct without mechanics: the liver's bed, the common bile duct, and the gallbladder at a neck."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.visualization.normals import vertex_normals
from trocar.services.visualization.picture import PictureLayout
from trocar.services.visualization.tissue import COMMON_DUCT, GALLBLADDER, LIVER, Bytes, TissueLook, tissue_colours
from trocar.services.visualization.tube import spline, sweep_tube, tube_triangles

_UP = np.array([0.0, 0.0, 1.0])
_BED_M = 0.26  # half of its width
_BELOW_M = 0.026  # the duct, by eye: shadows fall on it without its bed hiding a tool
#: Radii of the lens' light on the bed: up to the first it is lit, beyond the second dark.
_LIT_M, _DARK_M = 0.05, 0.19
#: The gallbladder: distance from the neck and radius of its places, in radii of the neck.
_ALONG = (-0.5, 1.0, 2.5, 5.0, 9.0, 14.0, 19.0, 22.0, 23.3, 23.5)
_WIDE = (1.25, 1.3, 1.9, 2.5, 3.6, 4.7, 4.4, 3.0, 1.3, 0.02)


@dataclass(frozen=True, slots=True)
class Piece:
    """A static surface with its colours."""

    points_m: Float32Array
    normals: Float32Array
    triangles: IntArray
    colours: Bytes
    look: TissueLook


def scenery(layout: PictureLayout, *, cells: int) -> list[Piece]:
    """Return the scenery behind the duct of `layout`; the bed has `cells` squares a side."""
    pieces = [_bed(layout.rest_m, cells)]
    if len(layout.mouth) and len(layout.clamped):
        pieces.append(_common_duct(layout))
        pieces += [_gallbladder(layout)] if layout.neck else []
    return pieces


def _bed(rest_m: Float32Array, cells: int) -> Piece:
    low, high = rest_m.min(axis=0), rest_m.max(axis=0)
    share = np.linspace(-1.0, 1.0, cells + 1)
    x, y = np.meshgrid(*2 * [_BED_M * (0.3 + 0.7 * share**2) * share], indexing="ij")  # finer where shadows fall
    away = np.hypot(x, y)
    z = low[2] - _BELOW_M + 5e-3 * _wave(1e3 * x, 1e3 * y) + 0.42 * np.maximum(0.0, away - 0.07)
    centre = 0.5 * (low + high)
    points_m = np.stack([x + centre[0], y + centre[1], z], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()[:, None]
    right, ahead = corner + cells + 1, corner + 1
    triangles = np.concatenate([np.hstack([corner, right, ahead]), np.hstack([right, right + 1, ahead])])
    light = 1.0 - 0.93 * np.clip((away.reshape(-1, 1) - _LIT_M) / (_DARK_M - _LIT_M), 0.0, 1.0)
    colours = (tissue_colours(points_m, LIVER) * light).astype(np.uint8)
    return _piece(points_m, triangles.astype(np.int32), colours, LIVER)


def _wave(x: FloatArray, y: FloatArray) -> FloatArray:
    long = np.sin(0.055 * x + 1.3) * np.cos(0.07 * y)
    return np.asarray(long + 0.5 * np.sin(0.13 * x - 0.09 * y) + 0.3 * np.sin(0.21 * y + 2.0))


def _common_duct(layout: PictureLayout) -> Piece:
    """Return a wider tube across the held end, sinking into the bed on both sides."""
    held, mouth = (layout.rest_m[list(nodes)].mean(axis=0, dtype=float) for nodes in (layout.clamped, layout.mouth))
    away = (held - mouth) / np.linalg.norm(held - mouth)
    across = np.cross(away, _UP)
    across /= np.linalg.norm(across)
    own_mm = 1e3 * float(np.linalg.norm(layout.rest_m[layout.clamped[0]] - held))
    steps = np.array([-11, -9, -6, -3.6, -1.8, 0, 1.8, 3.6, 6, 9, 11])[:, None]
    ahead_mm = 1.08 * own_mm + 0.25 * steps**2 + 0.35 * steps
    places = held + 1e-3 * (ahead_mm * away + 1.25 * own_mm * steps * across - 0.02 * np.abs(steps) ** 3.25 * _UP)
    ring = np.arange(8 * (len(places) - 1) + 1)
    radii = 1.62e-3 * own_mm * (1 + 0.025 * np.sin(0.5 * ring) + 0.02 * np.sin(0.23 * ring + 1.0))
    return _tube(places, radii, COMMON_DUCT)


def _gallbladder(layout: PictureLayout) -> Piece:
    """Return a pear from the neck on along the duct's axis, sinking into the bed, as the page's (`backdrop.js`)."""
    held, mouth = (layout.rest_m[list(nodes)].mean(axis=0, dtype=float) for nodes in (layout.clamped, layout.mouth))
    away = (mouth - held) / np.linalg.norm(mouth - held)
    across = np.cross(away, _UP)
    across /= np.linalg.norm(across)
    own_m = float(np.linalg.norm(layout.rest_m[layout.mouth[0]] - mouth))
    s = np.array(_ALONG)[:, None]
    sinks = 4.0 * (1.0 - np.exp(-0.012 * s**2))
    places = mouth + own_m * (s * away + 0.012 * s * np.maximum(0.0, s) * across - sinks * _UP)
    wide = np.array([[own_m * each, 0.0, 0.0] for each in _WIDE])
    return _tube(places, spline(wide, 8)[:, 0].astype(np.float64), GALLBLADDER)


def _tube(places: FloatArray, radii_m: FloatArray, look: TissueLook) -> Piece:
    """Return the tube through places (n, 3) with the radius of each ring, eight of them from a place to the next."""
    line = spline(places, 8)
    points_m, normals = np.zeros((2, 40 * len(line), 3), np.float32)
    sweep_tube(line, radii_m.astype(np.float32), points_m, normals)
    return _piece(points_m, tube_triangles(len(line), 40), tissue_colours(points_m, look), look)


def _piece(points_m: Float32Array, triangles: IntArray, colours: Bytes, look: TissueLook) -> Piece:
    normals = np.zeros_like(points_m)
    vertex_normals(points_m, triangles, normals)
    return Piece(points_m, normals, triangles, colours, look)
