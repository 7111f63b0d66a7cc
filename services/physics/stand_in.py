"""A substitute for a scene's duct while that is being built, so that kernels can be compiled meanwhile.

Kernels do not depend on the number of nodes and modes nor on values: a coarse tube with artificial modes calls the
same kernels as the scene's duct.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.residual.blocks import Residual
from trocar.services.mechanics.scene import QualityLevel, SceneModel
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

#: Cells, modes, and the first mode's frequency: as few as kernels can be compiled and called with, and a step that is
#: stable.
_N_AROUND, _N_ALONG, _N_MODES = 8, 10, 4
_OMEGA_RAD_S = 2.0 * np.pi * 100.0  # any that a step of 1 ms resolves, as it turns by less than a radian in one
#: Amplitude of a mass-normalised mode, 1/sqrt(kg), and residual compliance of a node, m/N, as in a soft duct.
_SHAPE, _COMPLIANCE_M_N = 1.0, 1e-3


def stand_in_scene(scene: SceneModel) -> SceneModel:
    """Return the scene without its quality ladder and the effects of the wall, which need the real duct."""
    effects = {name: settings for name, settings in scene.effects.items() if not EFFECTS[name].kind.of_wall}
    return replace(scene, effects=effects, quality=(QualityLevel(),), essential=())


def stand_in_duct(scene: SceneModel) -> ReducedDuct:
    """Return a coarse tube of the scene's radius and length whose modes are prescribed waves along it."""
    mesh = parametric_duct(DuctGeometry(scene.duct.radius_m, scene.duct.length_m, _N_AROUND, _N_ALONG))
    along = np.linspace(0.0, np.pi, _N_MODES * mesh.n_vertices * 3).reshape(mesh.n_vertices, 3, _N_MODES)
    basis = ModalBasis.from_modes(_OMEGA_RAD_S * np.arange(1.0, _N_MODES + 1.0), _SHAPE * np.sin(along))
    blocks = np.zeros((mesh.n_vertices, mesh.n_vertices, 3, 3), np.float32)
    blocks[np.arange(mesh.n_vertices), np.arange(mesh.n_vertices)] = _COMPLIANCE_M_N * np.eye(3, dtype=np.float32)
    return ReducedDuct(mesh, basis, Residual.full(blocks), np.full(_N_MODES, scene.duct.damping_ratio))
