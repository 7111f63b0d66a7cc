"""The duct of a scene as arrays, for who runs none of the mechanics: its surface and its modes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from services.cache_directory import cache_directory
from services.mechanics.reduction.reduced_duct import ReducedDuct
from services.mechanics.surface.centreline import centrelines
from services.scenes.load import load_scene
from services.scenes.ready import load_duct


def duct_file(duct: ReducedDuct) -> bytes:
    """Return an npz file: vertices_m (n, 3), triangles (t, 3), modes (n, 3, m) in 1/sqrt(kg), and basis_hash.

    Nodes are at ``vertices_m + modes @ q``; loads near contacts add a little: a recording's picture has it. For each
    named end but the mouth there is the way to it at rest, ``way_NAME`` (k, 3) in m.
    """
    file = io.BytesIO()
    ways: dict[str, Any] = {f"way_{name}": way_m for name, way_m in centrelines(duct.mesh).items()}
    np.savez_compressed(
        file,
        vertices_m=duct.mesh.vertices_m,
        triangles=duct.mesh.triangles,
        modes=duct.basis.Phi.astype(np.float32),
        basis_hash=np.array(duct.basis.content_hash),
        **ways,
    )
    return file.getvalue()


def read_duct(scene: str, overrides: Sequence[str]) -> bytes:
    """Return the file of the duct of a scene. Raises UserError if the scene cannot be used."""
    duct = load_duct(load_scene(scene, overrides), cache_directory(), lambda stage, fraction: None)
    return duct_file(duct)
