"""As a scene of CHAI3D has it: a spring from proxy to device, no stiffer than the library says the arm can bear.

CHAI3D 3.3, `cPhantomDevice`: 400 N/m and 4 N s/m for a Touch, 1,000 N/m and 8 N s/m for another Phantom. A scene takes
its walls' stiffness as a share of that, `cGenericTool` passes on what comes of it, the device clips it. No energy is
counted.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.feel.laws import Walls

_STIFFEST_N_M = {"Touch": 400.0}
_OTHERS_N_M = 1000.0


class Chai3d:
    """The wall as stiff as it may be."""

    def __init__(self, walls: Walls) -> None:
        stiffest = _STIFFEST_N_M.get(walls.file.model, _OTHERS_N_M)
        self._stiffness, self._most_n = np.minimum(walls.stiffness_n_m, stiffest), walls.file.max_force_n

    def force(self, x_m: FloatArray, v_m_s: FloatArray) -> FloatArray:
        """Return the force, (n,)."""
        found: FloatArray = np.clip(-self._stiffness * x_m, 0.0, self._most_n)
        return found
