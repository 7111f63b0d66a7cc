"""A session from a new profile by mouse alone, on a real rig: name, attempts, report, replay, curve, next task."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import chromium
from tests.page.school_session import bench, session

pytestmark = [
    pytest.mark.rig,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]


def test_a_session_from_a_new_profile(tmp_path: Path) -> None:
    with bench(tmp_path) as mouse:
        for course in session(mouse):
            assert course.headline.startswith("Well done"), course
            assert "late" not in course.not_counted, "nothing is late in simulated time"
