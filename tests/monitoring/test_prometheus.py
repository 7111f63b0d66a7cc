"""A real Prometheus with the deployed rules scrapes a running rig: what its panels show, and when it alarms."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml

from services.runtime.rig import Transport
from services.supervisor.page_place import page_file
from tests.monitoring.exporter import DASHBOARDS, FOLDER, IN_FULL, RULES, panels
from tests.patience import PATIENCE_S
from tests.ports import free_port
from tests.rig.conftest import SCENE, Rig, running_rig
from tests.with_us import with_us

PROMETHEUS = shutil.which("prometheus")
pytestmark = [
    pytest.mark.rig,
    pytest.mark.timeout(900),
    pytest.mark.skipif(PROMETHEUS is None, reason="prometheus is not installed (Debian: prometheus)"),
]
#: What a busy machine may set off: no fault was injected for these, and none is proved by them.
OF_A_BUSY_MACHINE = {"TrocarBudgetBurns", "TrocarBudgetLeaks", "TrocarPathSlow"}
#: The rig is not started again for a stall, and has a budget that a machine shared with others does not spend.
OVERRIDES = [
    "supervisor.heartbeat_timeout_s=60",
    *(f"contracts.loops.{loop}.miss_ratio=0.005" for loop in ("gateway", "haptics", "physics")),
]
Alert = tuple[str, str]


@dataclass
class Monitor:
    """A Prometheus, and the rig that it looks at."""

    rig: Rig
    client: httpx.Client

    def ask(self, query: str) -> list[dict[str, Any]]:
        answer = self.client.get("/api/v1/query", params={"query": query}).json()
        assert answer["status"] == "success", f"{query}: {answer}"
        result: list[dict[str, Any]] = answer["data"]["result"]
        return result

    def firing(self) -> set[Alert]:
        """Return the alerts of the rig with the process, loop, device or path that each is about."""
        told = self.client.get("/api/v1/alerts").json()["data"]["alerts"]
        labels = [alert["labels"] for alert in told if alert["state"] == "firing" and alert["labels"]["rig"] == "test"]
        return {
            (each["alertname"], next((each[key] for key in ("service", "loop", "name", "path") if key in each), ""))
            for each in labels
        }

    def has_looked(self, times: int) -> bool:
        try:
            return bool(self.ask(f'sum_over_time(up{{rig="test"}}[1m]) > {times}'))
        except (httpx.TransportError, ValueError):  # it does not serve yet
            return False

    def until(self, condition: Callable[[], bool], what: str) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, f"not within {PATIENCE_S} s: {what}; firing: {self.firing()}"
            time.sleep(0.3)
            self.rig.observer.look()


@contextmanager
def _prometheus(folder: Path, target: str) -> Iterator[str]:
    """Run one with the deployed configuration, but that it looks every second, at this rig, and at it in full too."""
    config = yaml.safe_load((FOLDER / "prometheus" / "prometheus.yml").read_text())
    config["global"] = dict.fromkeys(config["global"], "1s")
    config["rule_files"] = [str(file) for file in RULES]
    [job] = config["scrape_configs"]
    job["file_sd_configs"] = [{"files": [str(folder / "rigs.yml")]}]
    whole = {"job_name": "whole", "params": {"level": ["full"]}}
    config["scrape_configs"].append({**whole, "static_configs": [{"targets": [target], "labels": {"rig": "whole"}}]})
    (folder / "rigs.yml").write_text(yaml.safe_dump([{"targets": [target], "labels": {"rig": "test"}}]))
    (folder / "prometheus.yml").write_text(yaml.safe_dump(config))
    assert PROMETHEUS is not None
    address = f"127.0.0.1:{free_port()}"
    options = {"config.file": folder / "prometheus.yml", "storage.tsdb.path": folder / "data"}
    words = [f"--{name}={value}" for name, value in {**options, "web.listen-address": address}.items()]
    with (folder / "prometheus.log").open("wb") as log:
        process = subprocess.Popen(with_us([PROMETHEUS, *words]), stdout=log, stderr=subprocess.STDOUT)
    try:
        yield f"http://{address}"
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


@pytest.fixture(scope="module")
def monitor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Monitor]:
    directory = tmp_path_factory.mktemp("monitored")
    with running_rig(directory, str(SCENE), OVERRIDES) as rig:
        page = json.loads(page_file(Transport(directory=directory / "bus")).read_text())["address"]
        with (
            _prometheus(directory, httpx.URL(page).netloc.decode()) as address,
            httpx.Client(base_url=address, timeout=PATIENCE_S) as client,
        ):
            made = Monitor(rig, client)
            made.until(lambda: made.has_looked(3), "three scrapes")
            yield made


def test_a_real_rig_has_at_most_200_series_in_a_summary(monitor: Monitor) -> None:
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
    """After the panels, which are asked for meanwhile: what is not well for ten seconds alarms."""
    monitor.until(lambda: monitor.has_looked(15), "fifteen scrapes")
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
