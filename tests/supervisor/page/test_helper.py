"""Processes beside the rig are started again when they end, and rest for a minute when that does not help."""

from __future__ import annotations

import time
from itertools import pairwise
from pathlib import Path

from tests.patience import PATIENCE_S
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.crew.restart_policy import HELPER_BACKOFF_S, HELPER_RETRIES, MINUTE_S
from trocar.services.supervisor.page.helper import Helper


def test_one_that_always_ends_is_started_some_times_and_then_once_a_minute(tmp_path: Path) -> None:
    said: list[str] = []
    spec = ProcessSpec("helper", "json.tool")  # its first argument names no file: it ends at once
    process = Helper(spec, tmp_path / "log", lambda _, text: said.append(text), tmp_path / "none")
    now_s, ended_s = 0.0, []
    for number in range(1, HELPER_RETRIES + 3):
        patient_until_s = time.monotonic() + PATIENCE_S
        while len(said) < number:
            assert time.monotonic() < patient_until_s
            process.run_turn(now_s)
            if process.is_running:
                time.sleep(0.005)  # it is left to end, in no time of the rig's
            else:
                now_s += 0.5
        ended_s.append(now_s)
    process.close()
    soon, rest = said[:HELPER_RETRIES], said[HELPER_RETRIES:]
    assert all("the helper's process ended with exit code" in text and "started again" in text for text in soon)
    assert "the rig goes on without for a minute" in rest[0]
    waits_s = [after - before for before, after in pairwise(ended_s)]
    assert waits_s[:HELPER_RETRIES] == list(HELPER_BACKOFF_S) * HELPER_RETRIES
    assert waits_s[HELPER_RETRIES] == MINUTE_S
