"""An instructor's desk that is killed disturbs no bench: two true rigs go on, and a new desk finds them."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.patience import PATIENCE_S
from tests.review.class_of_pages import TOKEN, until, write_roll
from tests.review.test_true_rigs import address_of
from tests.rig.conftest import SCENE, Rig, running_rig
from tests.with_us import with_us

pytestmark = [pytest.mark.rig, pytest.mark.long, pytest.mark.timeout(900)]
_WITH = {"X-Trocar-Token": TOKEN}
#: Two rigs starve each other on two cores: of each runs what is looked at.
_PATIENT = [
    "supervisor.heartbeat_timeout_s=30", "supervisor.watch_floor=false", "processes.recorder.enabled=false",
    "processes.visualization.enabled=false",
]  # fmt: skip
_GOES_ON_TICKS = 2000  # of each bench after the desk's death: two seconds of its time, a hundred times a stall


@contextmanager
def _desk(roll: Path, log: Path) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Start a desk as an instructor does; yield it and its address."""
    command = [sys.executable, "-m", "trocar.services.cli.app", "classroom", str(roll), "--port", "0"]
    with log.open("wb") as file:
        process = subprocess.Popen(with_us(command), stdout=file, stderr=subprocess.STDOUT, start_new_session=True)
    try:
        until(lambda: b"the class: open" in log.read_bytes(), "the desk serves", PATIENCE_S)
        found = re.search(r"http://[\d.]+:\d+", log.read_text())
        assert found is not None
        yield process, found[0]
    finally:
        process.kill()
        process.wait()


def _rows(desk: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = httpx.get(f"{desk}/api/class", headers=_WITH, timeout=PATIENCE_S).json()["rigs"]
    return rows


def _run_of(bench: Rig) -> tuple[int, str, dict[str, int]]:
    """Return incarnation, attempt and processes of a bench: they change with every new start."""
    told = httpx.get(f"{address_of(bench)}api/state", timeout=PATIENCE_S).json()
    return told["incarnation"], told["attempt"]["attempt_id"], bench.observer.pids()


def _kill_while_it_acts(desk: str, process: subprocess.Popen[bytes]) -> int:
    """Kill a desk amid orders to both benches that follow each other at once; return how many it had carried out."""
    done: list[Any] = []

    def act() -> None:
        with httpx.Client(headers=_WITH, timeout=PATIENCE_S) as client, contextlib.suppress(httpx.HTTPError):
            while True:
                done.append(client.post(f"{desk}/api/act", json={"what": "order", "word": "bookmark"}).json())

    instructor = threading.Thread(target=act)
    instructor.start()
    try:
        until(lambda: len(done) >= 2, "acts are carried out", PATIENCE_S)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        instructor.join()
    assert all(each["ok"] for told in done for each in told["outcomes"]), done
    return len(done)


def _pause(desk: str) -> None:
    """Let a desk order both benches to pause, which they do."""
    done = httpx.post(f"{desk}/api/act", json={"what": "order", "word": "pause"}, headers=_WITH, timeout=PATIENCE_S)
    assert [each["ok"] for each in done.json()["outcomes"]] == [True, True]


def test_a_desk_that_is_killed_disturbs_no_bench_and_a_new_one_finds_them(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("a", "b")]
    for folder in folders:
        folder.mkdir()
    token = tmp_path / "class.token"
    token.write_text(TOKEN)
    token.chmod(0o600)
    told = [*_PATIENT, f"supervisor.web.class_token={token}"]
    with running_rig(folders[0], str(SCENE), told) as one, running_rig(folders[1], str(SCENE), told) as two:
        benches = (one, two)
        roll = write_roll(tmp_path / "class.toml", [address_of(each) for each in benches], bench_0="heron-17")

        def all_are_seen(desk: str) -> bool:
            return all(row["state"] in ("running", "degraded") and row["attempt"] for row in _rows(desk))

        with _desk(roll, tmp_path / "first.log") as (process, desk):
            until(lambda: all_are_seen(desk), "both are practised at", PATIENCE_S)
            before = [_run_of(each) for each in benches]
            acts = _kill_while_it_acts(desk, process)
            assert process.wait() == -signal.SIGKILL
        for bench in benches:
            bench.observer.look()
            bench.observer.samples.clear()
        for bench in benches:
            samples = bench.observer.samples
            bench.observer.until(
                lambda told=samples: bool(told) and told[-1].tick - told[0].tick >= _GOES_ON_TICKS, PATIENCE_S, "go on"
            )
        assert [_run_of(each) for each in benches] == before
        for bench in benches:
            assert len({(each.incarnation, each.begins) for each in bench.observer.samples}) == 1, "begun anew"
            assert {each.fault for each in bench.observer.samples} == {""}
            assert all(not state.safe_stop for _, state in bench.observer.states)
        with _desk(roll, tmp_path / "second.log") as (_, desk):
            until(lambda: all_are_seen(desk), "a new desk finds both", PATIENCE_S)
            assert [(row["name"], row["trainee"]) for row in _rows(desk)] == [("bench-0", "heron-17"), ("bench-1", "")]
            kept = httpx.get(f"{desk}/api/journal", headers=_WITH, timeout=PATIENCE_S).json()
            assert len(kept) >= acts, "what it did is kept"
            _pause(desk)
