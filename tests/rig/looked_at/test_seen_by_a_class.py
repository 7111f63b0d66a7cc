"""A true rig on a class page beside another: as it stands, and what is shown of it when it is killed.

The last that is done to the rig of this folder. Two true rigs at once, and the picture of one, are a matter of the long
run (`tests.review`): by day `test_classroom` has the picture from a view that is none, and `test_view_server` the view.
"""

from __future__ import annotations

import os
import signal
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.patience import PATIENCE_S
from tests.review.class_of_pages import TOKEN, rigs, served, until, write_roll
from tests.rig.conftest import Rig
from trocar.review.classroom import watch
from trocar.review.classroom.app import Classroom, build_app

pytestmark = [pytest.mark.rig, pytest.mark.timeout(900)]
_WITH = {"X-Trocar-Token": TOKEN}


def test_a_rig_as_it_stands_and_its_silence_once_it_is_killed(
    rig: Rig, address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "PERIOD_S", 0.2)
    with rigs(1) as (_, [other]):
        file = write_roll(tmp_path / "class.toml", [address, other], bench_0="heron-17")
        classroom = Classroom(file)
        with closing(classroom), served(build_app(classroom)) as [at]:

            def rows() -> list[dict[str, Any]]:
                told = httpx.get(f"{at}/api/class", headers=_WITH, timeout=PATIENCE_S).json()
                return list(told["rigs"])

            until(lambda: rows()[0]["state"] in ("running", "degraded"), "it runs")
            until(lambda: bool(rows()[0]["attempt"]), "it is practised at")
            assert rows()[0]["attempt"]["title"] == "Practice without a goal"
            assert [row["trainee"] for row in rows()] == ["heron-17", ""]
            observer = rig.observer  # who is not ready holds no lock, by which what is left over is ended
            observer.until(
                lambda: {p.state for p in observer.states[-1][1].processes} == {"ready"}, PATIENCE_S, "ready"
            )
            os.kill(rig.process.pid, signal.SIGKILL)
            until(lambda: [row["state"] == "silent" for row in rows()] == [True, False], "it is silent")
