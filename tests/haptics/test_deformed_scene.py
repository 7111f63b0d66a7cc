"""Haptics looks for touches on the wall and the catheter that physics has just moved."""

from __future__ import annotations

import numpy as np

from tests.physics.conftest import Rig

PRESSED, FAR = (0.02, 0.0, 0.006), (0.02, -0.05, 0.08)


def test_haptics_has_the_particles_of_the_newest_frame(rig: Rig) -> None:
    for _ in range(3):
        rig.turn(FAR, FAR)
    told = rig.physics.simulation.catheter.state.position_m.copy()
    rig.turn(FAR, FAR)  # takes what physics said last, then physics goes on
    np.testing.assert_array_equal(rig.haptics.grasping.scene.particles_m, told)
    assert not np.array_equal(told, rig.physics.simulation.catheter.state.position_m)
