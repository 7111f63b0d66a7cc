"""A real Prometheus with the deployed rules scrapes a running rig: what its panels show, and when it alarms."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from tests.monitoring.exporter import DASHBOARDS, IN_FULL, panels
from tests.rig.looked_at.conftest import Monitor

pytestmark = [pytest.mark.rig, pytest.mark.timeout(900)]
#: What a busy machine may set off: no fault was injected for these, and none is proved by them.
OF_A_BUSY_MACHINE = {"TrocarBudgetBurns", "TrocarBudgetLeaks", "TrocarPathSlow"}


def test_a_real_rig_has_at_most_200_series_in_a_summary(monitor: Monitor) -> None:
    monitor.until(lambda: monitor.has_looked(3), "three scrapes")
    [count] = monitor.ask('scrape_samples_scraped{rig="test"}')
    assert 100 < int(count["value"][1]) <= 200


@pytest.mark.parametrize("file", DASHBOARDS, ids=lambda file: file.stem)
def test_every_panel_is_answered(monitor: Monitor, file: Path) -> None:
    """Where a query leaves out what is zero, or has no goal, nothing may be an answer."""
    for row, title, expression in panels(file):
        rig = "whole" if row.startswith(IN_FULL) else "test"
        found = monitor.ask(expression.replace("$rig", rig).replace("$__rate_interval", "10s"))
        assert found or "> 0" in expression, f"{title}: {expression}"


def test_a_rig_that_is_well_alarms_nobody(monitor: Monitor) -> None:
    """What is not well for ten seconds alarms: it looks since the rig runs."""
    monitor.until(lambda: monitor.has_looked(13), "thirteen scrapes")
    assert [each["value"][1] for each in monitor.ask('up{rig="test"}')] == ["1"]
    assert {name for name, _ in monitor.firing()} <= OF_A_BUSY_MACHINE
    for loop in ("gateway", "haptics", "physics"):
        lost, ran, skipped = (
            float(monitor.ask(f'{name}{{rig="test", loop="{loop}"}}')[0]["value"][1])
            for name in ("trocar_deadline_misses_total", "trocar_loop_iterations_total", "trocar_loop_skipped_total")
        )
        rare = lost / (ran + skipped) < 0.005
        assert not rare or ("TrocarBudgetBurns", loop) not in monitor.firing()


@pytest.mark.long
def test_a_stall_is_told(monitor: Monitor) -> None:
    """While physics stands it is down; when it goes on, the ticks that it lost are far beyond its budget."""
    before = {alert for alert in monitor.firing() if alert[0] not in OF_A_BUSY_MACHINE}
    pid = monitor.rig.observer.pids()["physics"]
    os.kill(pid, signal.SIGSTOP)
    try:
        monitor.until(lambda: ("TrocarProcessDown", "physics") in monitor.firing(), "physics is down")
    finally:
        os.kill(pid, signal.SIGCONT)
    monitor.until(lambda: ("TrocarBudgetBurns", "physics") in monitor.firing(), "its budget burns")
    monitor.until(lambda: ("TrocarProcessDown", "physics") not in monitor.firing(), "physics is up again")
    others = {alert for alert in monitor.firing() if alert[0] not in OF_A_BUSY_MACHINE}
    assert others == before == set()
    assert monitor.rig.observer.pids()["physics"] == pid


def test_a_killed_process_is_told_and_no_other(monitor: Monitor) -> None:
    os.kill(monitor.rig.observer.pids()["recorder"], signal.SIGKILL)
    monitor.until(lambda: ("TrocarProcessRestarted", "recorder") in monitor.firing(), "the recorder was started again")
    about = {what for name, what in monitor.firing() if name not in OF_A_BUSY_MACHINE}
    assert about == {"recorder"}
