"""The insertion that the rig of this folder began with: the same hands as in process, through devices and bus.

The rig ends before that is judged: what is computed of it has the machine.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.rig.conftest import Rig, end
from tests.rig.course import DEEPEST_M, FORCE_STEP_N, Course
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.scenarios import insertion
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.studies.feel.tracking import WITHIN, compare, find_pinch

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]


def test_the_catheter_is_slid_20_mm_into_the_duct(rig: Rig, inserted: Course) -> None:
    end(rig.process, rig.directory)
    assert inserted.states[-1].reactions()[0].holds == 2
    assert 0.0 < inserted.deepest_m() < DEEPEST_M
    assert inserted.largest_step_n() < FORCE_STEP_N
    pushes = [max(math.hypot(*body.reactions()[i].force_n) for body in inserted.states) for i in (0, 1)]
    assert min(pushes) > 2e-3, "both hands feel something"
    scene = insertion().scene
    wall = scene, build_scene_duct(scene, cache_directory() / "bases")
    catheter, _ = compare(inserted.devices, inserted.states, wall).solved
    assert len(catheter) > 0.9 * len(inserted.states)
    assert np.mean(catheter < WITHIN) > 0.99, "the forces are those of the mechanics alone"
    pinch = find_pinch(inserted.devices, inserted.states, wall)
    assert abs(pinch.wall) < 0.02, "the wall is that of the full finite elements"
    assert pinch.applied < 0.1
