"""How stiff the folds of a duct are against a tip that pushes on their crests: statically, on any mesh.

What a push into a duct feels at most is an event: a tip that climbs a facet and slips off it. The stiffness of a fold
is the force at a stated deflection, and tells whether the mesh is fine enough for the wall itself.
"""

from __future__ import annotations

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.duct_recipe import duct_recipe
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.surface.curved_tube import CurvedTube
from trocar.services.mechanics.surface.mesh import TriangleMesh, triangle_areas_m2
from trocar.services.scenes.ready import load_surface

TIP_RADIUS_M = 0.6e-3
"""Of the area that is pushed, by a pressure that falls to zero at its rim as the square of the distance."""


def crest_stiffness_n_m(scene: SceneModel) -> tuple[FloatArray, FloatArray]:
    """Return the stiffness of each fold's crest along the duct and outwards (n,), where a tip's area is pushed.

    A crest where the common duct has taken in the wall has none.
    """
    tube = duct_tubes(scene.duct)[0]
    assert isinstance(tube, CurvedTube)
    mesh = load_surface(scene, cache_directory())
    area = np.zeros(mesh.n_vertices)
    np.add.at(area, mesh.triangles, np.repeat(triangle_areas_m2(mesh)[:, None] / 3.0, 3, axis=1))
    pushes = [(_shares(mesh, area, crest_m), along, outward) for crest_m, along, outward in _crests(tube)]
    loads = [share[:, None] * way for share, *ways in pushes if share.any() for way in ways]
    forces = np.concatenate([np.array(loads), np.zeros((len(loads), mesh.n_vertices, 3))], axis=2)
    model = duct_recipe(scene.duct, mesh).model()
    free = forces.reshape(len(loads), -1).T[model.free_dofs]
    stiffness_n_m = 1.0 / np.einsum("fk,fk->k", free, model.solve_free(free))
    return stiffness_n_m[::2], stiffness_n_m[1::2]


def _crests(tube: CurvedTube) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return of each fold the middle of its crest, the direction of the duct there and that away from its axis."""
    folds = tube.folds
    assert folds is not None
    made = []
    for k in range(round((folds.to_m - folds.from_m) / folds.pitch_m)):
        at_m, around = folds.from_m + (k + 0.5) * folds.pitch_m, folds.begin_rad + (k + 0.5) * folds.arc_rad
        middle_m, (along, side, across) = tube.place(at_m)
        outward = np.cos(around) * side + np.sin(around) * across
        inward_m = float(folds.inward_m(np.array([at_m]), np.array([around]))[0])
        made.append((middle_m + (tube.radius_at(at_m) - inward_m) * outward, along, outward))
    return made


def _shares(mesh: TriangleMesh, area: FloatArray, crest_m: FloatArray) -> FloatArray:
    """Return what each node (n,) takes of a push on a crest, 0 for all where the common duct has taken in the wall."""
    away = np.linalg.norm(mesh.vertices_m - crest_m, axis=1) / TIP_RADIUS_M
    share: FloatArray = area * np.clip(1.0 - away**2, 0.0, None)
    return share / max(float(share.sum()), np.finfo(float).tiny)
