"""Colours of wet tissue, one a vertex: clouds and veins from noise attached to the undeformed body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.services.mechanics.arrays import Float32Array, FloatArray

Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class TissueLook:
    """Hexadecimal colours of flesh, paler clouds and veins; grains a millimetre; gloss, 0 to 1."""

    flesh: str
    pale: str
    vein: str
    grain: float
    wet: float = 0.7


DUCT = TissueLook("#b9594f", "#d99a83", "#86283a", 0.7)
COMMON_DUCT = TissueLook("#8f4238", "#b4785c", "#631c26", 0.7)
GALLBLADDER = TissueLook("#56695a", "#8f9170", "#6b3030", 0.45)
LIVER = TissueLook("#4d1c17", "#6b2f23", "#33100f", 0.3, 0.3)


def rgb(colour: str) -> FloatArray:
    """Return the components (3,) of a hexadecimal colour, 0 to 255."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], float)


def tissue_colours(rest_m: Float32Array, look: TissueLook) -> Bytes:
    """Return a colour (n, 3) for each point of the undeformed body."""
    grain = rest_m.astype(float) * 1e3 * look.grain
    cloud = 0.7 * np.clip((_layers(0.35 * grain) - 0.3) / 0.5, 0.0, 1.0)[:, None]
    vein = 0.5 * np.clip(1.0 - np.abs(_layers(0.22 * grain + 11.0) - 0.5) / 0.055, 0.0, 1.0)[:, None]
    colour = rgb(look.flesh) * (1.0 - cloud) + rgb(look.pale) * cloud
    return np.asarray(colour * (1.0 - vein) + rgb(look.vein) * vein, np.uint8)


def _layers(places: FloatArray) -> FloatArray:
    return 0.6 * _noise(places) + 0.4 * _noise(2.03 * places + 7.1)


def _noise(places: FloatArray) -> FloatArray:
    """Return value noise at `places` (n, 3): random at whole numbers, smooth in between, 0 to 1."""
    cell = np.floor(places)
    share = places - cell
    share = share * share * (3.0 - 2.0 * share)
    total = np.zeros(len(places))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, share, 1.0 - share), axis=1)
        value = np.sin((cell + corner) @ (127.1, 311.7, 74.7)) * 43758.5453
        total += weight * (value - np.floor(value))
    return total
