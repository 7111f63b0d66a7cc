"""Two true rigs on one class page: as each stands, with a picture, and what is shown of one that is killed.

By day it is one (`tests/rig/looked_at`): two starve each other on two cores.
"""

from __future__ import annotations

import json
import os
import signal
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.patience import PATIENCE_S
from tests.review.class_of_pages import TOKEN, served, until, write_roll
from tests.rig.conftest import SCENE, Rig, running_rig
from trocar.review.classroom.app import Classroom, build_app
from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.page.page_place import page_file

pytestmark = [pytest.mark.rig, pytest.mark.long, pytest.mark.timeout(900)]
_WITH = {"X-Trocar-Token": TOKEN}


def address_of(rig: Rig) -> str:
    """Return where a rig serves its page."""
    address: str = json.loads(page_file(Transport(directory=rig.directory / "bus")).read_text())["address"]
    return address


def test_two_rigs_a_picture_and_one_that_is_killed(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("a", "b")]
    for folder in folders:
        folder.mkdir()
    # Two rigs starve each other: of each runs what is looked at.
    patient = [
        "supervisor.heartbeat_timeout_s=30", "supervisor.watch_floor=false", "processes.recorder.enabled=false",
    ]  # fmt: skip
    blind = [*patient, "processes.visualization.enabled=false"]
    file = tmp_path / "class.toml"
    with running_rig(folders[0], str(SCENE), patient) as one:
        classroom = Classroom(write_roll(file, [address_of(one)], bench_0="heron-17"))
        with closing(classroom), served(build_app(classroom)) as [address]:

            def rows() -> list[dict[str, Any]]:
                told = httpx.get(f"{address}/api/class", headers=_WITH, timeout=PATIENCE_S).json()
                found: list[dict[str, Any]] = told["rigs"]
                return found

            images: list[bytes] = []

            def drawn() -> bool:  # comes after all others: on a busy machine the first try is too late
                answer = httpx.get(f"{address}/api/picture/bench-0", headers=_WITH, timeout=PATIENCE_S)
                images.append(answer.content)
                return answer.status_code == 200

            until(drawn, "a picture", PATIENCE_S)
            assert images[-1].startswith(b"\x89PNG")
            with running_rig(folders[1], str(SCENE), blind) as two:
                write_roll(file, [address_of(one), address_of(two)], bench_0="heron-17")
                runs = ("running", "degraded")
                until(lambda: [row["state"] in runs for row in rows()] == [True, True], "both run", PATIENCE_S)
                until(lambda: all(row["attempt"] for row in rows()), "both are practised at", PATIENCE_S)
                assert [row["trainee"] for row in rows()] == ["heron-17", ""]
                assert {row["attempt"]["title"] for row in rows()} == {"Practice without a goal"}
                os.kill(one.process.pid, signal.SIGKILL)
                until(
                    lambda: [row["state"] == "silent" for row in rows()] == [True, False], "one is silent", PATIENCE_S
                )
