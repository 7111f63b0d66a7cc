"""The surface in a VTP file; what VTK finds wrong with it is one sentence."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.meshes.errors import MeshError


def read_vtp(path: Path) -> tuple[FloatArray, IntArray]:
    """Return (n, 3) vertices in the file's unit and (m, 3) triangles; polygons are split.

    Raises MeshError: says what VTK said first.
    """
    import pyvista

    with _quiet(), pyvista.vtk_verbosity("off"), pyvista.VtkErrorCatcher() as caught:
        surface = pyvista.read(path)
    if caught.events:
        raise MeshError(
            f"{path}: not a readable triangle surface ({caught.events[0].alert.splitlines()[0].rstrip('.')})"
        )
    triangles = surface.extract_surface(algorithm="dataset_surface").triangulate()
    return np.asarray(triangles.points, np.float64), np.asarray(triangles.regular_faces, np.int32)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep from the terminal what is told by an error."""
    root = logging.getLogger()
    was_disabled, root.disabled = root.disabled, True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        root.disabled = was_disabled
