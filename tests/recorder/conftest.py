"""Waiting for what another thread does; a recording of a rig in memory."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.physics.conftest import Rig, let_time_pass
from tests.recorder.recorded_rig import LADDER, record
from tests.runtime.conftest import eventually

__all__ = ["eventually"]
TICKS = 900


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording that tests may read."""
    with pytest.MonkeyPatch.context() as patch:
        let_time_pass(patch)
        return record(tmp_path_factory.mktemp("recorded") / "a.mcap", Rig(LADDER), TICKS)
