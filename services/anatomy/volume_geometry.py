"""Whether a volume's grid lies in space as one of a scanner does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trocar.services.meshes.errors import MeshError

SPACING_MM = (1e-3, 50.0)
"""A finer or coarser voxel is in another unit than millimetres."""
MOST_SKEW = 1e-3
"""Of the axes' scalar products: far above the rounding of six digits in a header, far below the tilt of a gantry by one
degree (0.017), which is resampled first."""


def judge_geometry(
    path: Path, origin_mm: npt.NDArray[Any], spacing_mm: npt.NDArray[Any], directions: npt.NDArray[Any]
) -> None:
    """Refuse a grid with no size, or one that is skewed.

    Raises MeshError that names the file and the value.
    """
    for axis, size in zip("ijk", spacing_mm.tolist(), strict=True):
        if not (np.isfinite(size) and SPACING_MM[0] <= size <= SPACING_MM[1]):
            low, high = SPACING_MM
            raise MeshError(f"{path}: the spacing along {axis} is {size:g} mm, a voxel has {low:g} to {high:g} mm")
    if not (np.isfinite(origin_mm).all() and np.isfinite(directions).all()):
        raise MeshError(f"{path}: origin or axes are no numbers: {origin_mm.tolist()}, {directions.tolist()}")
    skew = float(np.abs(directions.T @ directions - np.eye(3)).max())
    if skew > MOST_SKEW:
        raise MeshError(f"{path}: the axes are not at right angles (off by {skew:.2g}): resample the volume first")
