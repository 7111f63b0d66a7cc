"""The duct of a scene as arrays, for who runs none of the mechanics: its surface and its modes.

``python -m services.scenes.duct_file SCENE [KEY=VALUE ...]`` writes it to standard output.
"""

from __future__ import annotations

import io
import sys

import numpy as np

from services.cache_directory import cache_directory
from services.mechanics.reduction.reduced_duct import ReducedDuct
from services.runtime.errors import UserError
from services.scenes.load import load_scene
from services.scenes.ready import load_duct


def duct_file(duct: ReducedDuct) -> bytes:
    """Return an npz file: vertices_m (n, 3), triangles (t, 3), modes (n, 3, m) in 1/sqrt(kg), and basis_hash.

    Nodes are at ``vertices_m + modes @ q``; loads near contacts add a little: a recording's picture has it.
    """
    file = io.BytesIO()
    np.savez_compressed(
        file,
        vertices_m=duct.mesh.vertices_m,
        triangles=duct.mesh.triangles,
        modes=duct.basis.Phi.astype(np.float32),
        basis_hash=np.array(duct.basis.content_hash),
    )
    return file.getvalue()


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: python -m services.scenes.duct_file SCENE [KEY=VALUE ...]")
    try:
        scene = load_scene(sys.argv[1], sys.argv[2:])
        sys.stdout.buffer.write(duct_file(load_duct(scene, cache_directory(), lambda stage, fraction: None)))
    except UserError as error:
        sys.exit(str(error))
