"""Soft shadows of tools, catheter and duct on the surfaces below, computed at vertices.

A distant lamp of finite width is partly hidden by rods: the shadow is sharp of touching ones and soft of distant ones,
which shows the distance. A shadow map would take twice the processor time.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import row, subtract
from trocar.services.visualization.picture import Picture, PictureLayout
from trocar.services.visualization.tissue import Bytes

_LAMP_AT = np.array([-60.0, 35.0, 110.0], np.float32)  # across both usual tools, so that neither hides its own shadow
SUN = _LAMP_AT / np.linalg.norm(_LAMP_AT)
ACROSS = np.linalg.qr(np.column_stack([SUN, np.eye(3, dtype=np.float32)[:, :2]]))[0][:, 1:]
_SEEN = np.column_stack([ACROSS, SUN])
_LAMP, _SHARPEST_M = 0.2, 0.5e-3
"""Width of the lamp over its distance; smallest width of an edge, resolved by the vertices."""
_DARK = 0.6  # as a bright lamp leaves it: judged by eye, as the lamp's width is
#: Rods by which duct and catheter cast shadows: as many as bends of either have no corners that are seen; time grows
#: with them.
_SECTIONS, _PIECES = 10, 12


def hidden(points_m: Float32Array, starts_m: Float32Array, ends_m: Float32Array, radii_m: Float32Array) -> Float32Array:
    """Return the fraction (n,) of the lamp hidden by rods from `starts_m` to `ends_m` (k, 3) at each point (n, 3).

    Seen along the light a rod is a strip; one narrower than the lamp hides the ratio of their widths.
    """
    share = np.empty(len(points_m), np.float32)
    _hide(points_m @ _SEEN, starts_m @ _SEEN, (ends_m - starts_m) @ _SEEN, radii_m, share)
    return share


@kernel
def _hide(
    points: Float32Array, starts: Float32Array, along: Float32Array, radii: Float32Array, out: Float32Array
) -> None:
    """Write the fractions (n,); coordinates of points (n, 3) and rods (k, 3) are two across the light and one along."""
    for i in range(points.shape[0]):
        seen = 1.0
        for k in range(starts.shape[0]):
            x, y, height = subtract(row(points, i), row(starts, k))
            u, v, rise = row(along, k)
            at = min(max((x * u + y * v) / max(u * u + v * v, 1e-12), 0.0), 1.0)
            above = at * rise - height
            if above <= 0.0:
                continue
            edge = _SHARPEST_M + _LAMP * above
            inside = radii[k] + 0.5 * edge - math.hypot(x - at * u, y - at * v)
            if inside > 0.0:
                seen *= 1.0 - min(inside / edge, 1.0, 2.0 * radii[k] / edge)
        out[i] = 1.0 - seen


def darkened(colours: Bytes, share: Float32Array) -> Bytes:
    """Return colours (n, 3) darkened by the hidden fraction (n,) of the lamp."""
    return (colours * (1.0 - _DARK * share[:, None])).astype(np.uint8)


RodArrays = tuple[Float32Array, Float32Array, Float32Array]


class Rods:
    """Rods that approximate the shadow casters of a layout: instruments first, the duct's last."""

    def __init__(self, layout: PictureLayout) -> None:
        self._layout = layout
        centred = layout.rest_m - layout.rest_m.mean(axis=0)
        axis = np.linalg.svd(centred, full_matrices=False)[2][0]
        along = centred @ axis
        place = (along - along.min()) / (np.ptp(along) + 1e-9)
        member = np.minimum(_SECTIONS * place, _SECTIONS - 1).astype(int) == np.arange(_SECTIONS)[:, None]
        member = member[member.any(axis=1)]
        self._mean = member / member.sum(axis=1, keepdims=True)
        off_axis_m = centred - along[:, None] * axis
        self._duct_radius_m = float(np.sqrt(np.mean(np.sum(off_axis_m**2, axis=1))))

    def instruments(self, picture: Picture) -> RodArrays:
        """Return starts and ends (k, 3) and radii (k,) of tools and catheter."""
        starts: list[FloatArray] = []
        ends: list[FloatArray] = []
        radii: list[float] = []
        for shape, pose, opening_rad in zip(self._layout.tools, picture.poses, picture.jaw_rad, strict=True):
            half, turn = 0.5 * float(opening_rad), Rotation.from_quat(pose[3:], scalar_first=True)
            jaws = [(np.cos(half), side * np.sin(half), 0.0) for side in (1, -1) if shape.has_jaws]
            starts += [np.array(shape.port_m), *[pose[:3]] * len(jaws)]
            ends += [pose[:3], *(pose[:3] + shape.jaw_length_m * turn.apply(jaw) for jaw in jaws)]
            radii += [shape.shaft_radius_m, *[1.3 * shape.jaw_radius_m] * len(jaws)]
        for part, radius_m in self._layout.rods():
            line = picture.centreline_m[part][:: max(1, len(picture.centreline_m) // _PIECES)]
            starts, ends, radii = [*starts, *line[:-1]], [*ends, *line[1:]], [*radii, *[radius_m] * (len(line) - 1)]
        return _single(starts, ends, radii)

    def duct(self, picture: Picture) -> RodArrays:
        """Return the same of the duct."""
        middle_m = self._mean @ picture.points_m
        return _single(middle_m[:-1], middle_m[1:], np.full(len(middle_m) - 1, self._duct_radius_m))


def _single(*arrays: object) -> RodArrays:
    starts_m, ends_m, radii_m = (np.asarray(array, np.float32) for array in arrays)
    return starts_m, ends_m, radii_m
