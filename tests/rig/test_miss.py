"""The miss on a running rig: the same hands as in process, through devices, bus and all processes."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.rig.conftest import running_rig
from tests.rig.course import DEEPEST_M, FORCE_STEP_N, Course, hands

pytestmark = [pytest.mark.rig, pytest.mark.long, pytest.mark.timeout(600)]

LASTS_S = 200.0  # it takes five seconds


def test_aimed_beside_the_mouth_it_buckles_outside(tmp_path: Path) -> None:
    with running_rig(tmp_path, "miss", hands("miss"), keeps_solved=True) as rig:
        seen = Course.of(rig.observer)
        rig.observer.until(lambda: seen.is_bowed(1e-3), LASTS_S, "the catheter bows out")
    assert max(body.catheter.inserted_length_m for body in seen.states) == 0.0
    assert seen.deepest_m() < DEEPEST_M
    assert seen.largest_step_n() < FORCE_STEP_N
    assert max(math.hypot(*body.reactions()[0].force_n) for body in seen.states) > 0.02
