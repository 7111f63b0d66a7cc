"""The supervisor's companions are judged as the rest: one that is silent, or has ended, is said and started again."""

from __future__ import annotations

import json
import os
import signal
import urllib.error
import urllib.request

import pytest

from tests.by_day import by_day
from tests.supervisor.fakes import Fakes, Scenario, page_servers, until, until_running
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.page.page_place import page_file

pytestmark = pytest.mark.usefixtures("soon")


@pytest.mark.parametrize(
    ("number", "stopped_s", "said"),
    by_day(
        [(signal.SIGSTOP, 0.1, "is stopped by a signal"), (signal.SIGSTOP, 60.0, "said nothing for")],
        [(signal.SIGKILL, 0.1, "ended")],
    ),
)
def test_a_page_that_hangs_or_ends_is_started_again(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, stopped_s: float, said: str
) -> None:
    monkeypatch.setattr("trocar.services.supervisor.page.helper.SILENT_S", 1.0)
    monkeypatch.setattr("trocar.services.supervisor.crew.silence.HEARTBEAT_S", stopped_s)

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        (first,) = page_servers()
        yield from until(lambda: _serves(supervisor))
        os.kill(first, number)
        yield from until(lambda: any(f"the page's process {said}" in event.text for event in supervisor.events))
        yield from until(lambda: page_servers() not in ([], [first]))
        assert all(member.restarts.count == 0 for member in supervisor.crew.members.values()), "the rig goes on"

    fakes.play(scenario)


def _serves(supervisor: Supervisor) -> bool:
    """Return whether the page answers by now: then it has also beaten."""
    address = json.loads(page_file(supervisor.rig.transport).read_text())["address"]
    try:
        with urllib.request.urlopen(f"{address.rstrip('/')}/healthz", timeout=0.5):
            return True
    except urllib.error.HTTPError:  # it answers that the rig is not well
        return True
    except OSError:
        return False
