"""The duct of a scene as arrays, for who runs none of the mechanics: its surface and its modes.

``python -m trocar.services.scenes.duct_file SCENE [KEY=VALUE ...]`` prints the file.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects import build_effects
from trocar.services.mechanics.reduction.build import ignore_progress
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.surface.centreline import centrelines
from trocar.services.runtime.config.scene_findings import print_finding
from trocar.services.scenes.load import load_scene
from trocar.services.scenes.ready import load_duct


def duct_file(duct: ReducedDuct, scene: SceneModel | None = None) -> bytes:
    """Return an npz file: vertices_m (n, 3), triangles (t, 3), modes (n, 3, m) in 1/sqrt(kg), and basis_hash.

    Nodes are at ``vertices_m + modes @ q``; loads near contacts add a little: a recording's picture has it. For each
    named end but the mouth there is the way to it at rest, ``way_NAME`` (k, 3) in m. For each effect of the ``scene``
    that acts at a place of the duct ``place_NAME`` (7,) is its middle and its reach in m, and the direction there.
    """
    file = io.BytesIO()
    more: dict[str, Any] = {f"way_{name}": way_m for name, way_m in centrelines(duct.mesh).items()}
    for name, effect in build_effects(scene).items() if scene is not None else ():
        if (place_m := effect.place_m(duct.mesh)) is not None:
            more[f"place_{name}"] = place_m
    np.savez_compressed(
        file,
        vertices_m=duct.mesh.vertices_m,
        triangles=duct.mesh.triangles,
        modes=duct.basis.Phi.astype(np.float32),
        basis_hash=np.array(duct.basis.content_hash),
        **more,
    )
    return file.getvalue()


def _find(scene: str, overrides: Sequence[str]) -> bytes:
    loaded = load_scene(scene, overrides)
    return duct_file(load_duct(loaded, cache_directory(), ignore_progress), loaded)


if __name__ == "__main__":
    print_finding(_find)
