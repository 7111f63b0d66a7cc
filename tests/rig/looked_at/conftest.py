"""One rig that all tests of this folder look at: a crowd of viewers, perf, then a browser, then a Prometheus.

Before all of them its hands insert the catheter; the last test judges that, when the rig has ended.
Prometheus scrapes from the start on: it has to have seen the rig for a while before it is asked. What takes seconds
and needs no rig of its own is done meanwhile.
Those before the last kill a process, and then its supervisor.
"""

from __future__ import annotations

import json
import shutil
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

from tests.chromium import Chromium
from tests.monitoring.exporter import FOLDER, RULES
from tests.obeyed import until_obeyed
from tests.patience import PATIENCE_S
from tests.ports import free_port
from tests.rig.conftest import Rig, running_rig
from tests.rig.course import Course, hands
from tests.with_us import with_us
from trocar.services.cli.attempt import run_order
from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.page.page_place import page_file

PROMETHEUS = shutil.which("prometheus")
WINDOW_S = 1.0
INSERTED_M = 20e-3
LASTS_S = 200.0  # it takes three seconds
#: The rig is not started again for a stall, and has a budget that a machine shared with others does not spend.
OVERRIDES = [
    "supervisor.heartbeat_timeout_s=60", f"supervisor.window_s={WINDOW_S}", "recorder.sample_rate_hz=10",
    *hands("insertion"),
    *(f"contracts.loops.{loop}.miss_ratio=0.005" for loop in ("gateway", "haptics", "physics")),
]  # fmt: skip
Alert = tuple[str, str]


@pytest.fixture(scope="package")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    folder = tmp_path_factory.mktemp("looked-at")
    with running_rig(folder, "insertion", OVERRIDES, topics=("physics.health",), keeps_solved=True) as rig:
        yield rig


@pytest.fixture(scope="package", autouse=True)
def inserted(rig: Rig, scraped_from_the_start: None) -> Course:
    """Return the insertion; later nobody keeps what physics says, and the hands insert again."""
    course = Course.of(rig.observer)
    rig.observer.until(lambda: course.reaches(INSERTED_M), LASTS_S, "inserted")
    rig.observer.devices = rig.observer.solved = None
    until_obeyed(lambda: run_order("stub", (f"transport.directory={rig.directory / 'bus'}",), "new"))
    rig.observer.until(lambda: rig.observer.samples[-1].begins == 1, PATIENCE_S, "all begins again")
    return course


@pytest.fixture(scope="package")
def address(rig: Rig) -> str:
    """Return where its page is."""
    place = page_file(Transport(directory=rig.directory / "bus"))
    return str(json.loads(place.read_text())["address"])


@pytest.fixture(scope="package")
def browser(address: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    """Return one in which the page is open, with a picture."""
    with Chromium(tmp_path_factory.mktemp("profile")) as browser:
        browser.open(address)
        ready = "document.querySelector('#view.ready') !== null"
        browser.until(lambda: browser.evaluate(ready), PATIENCE_S, "the page loaded")
        browser.until(lambda: browser.text("#tick").endswith(" s"), PATIENCE_S, "a picture came")
        yield browser


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
    served = f"127.0.0.1:{free_port()}"
    options = {"config.file": folder / "prometheus.yml", "storage.tsdb.path": folder / "data"}
    words = [f"--{name}={value}" for name, value in {**options, "web.listen-address": served}.items()]
    with (folder / "prometheus.log").open("wb") as log:
        process = subprocess.Popen(with_us([PROMETHEUS, *words]), stdout=log, stderr=subprocess.STDOUT)
    try:
        yield f"http://{served}"
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


@pytest.fixture(scope="package")
def scraped_from_the_start(request: pytest.FixtureRequest) -> None:
    if PROMETHEUS is not None:
        request.getfixturevalue("monitor")


@pytest.fixture(scope="package")
def monitor(rig: Rig, address: str) -> Iterator[Monitor]:
    """Have a Prometheus look at the rig, where there is one."""
    if PROMETHEUS is None:
        pytest.skip("prometheus is not installed (Debian: prometheus)")
    with (
        _prometheus(rig.directory, httpx.URL(address).netloc.decode()) as served,
        httpx.Client(base_url=served, timeout=PATIENCE_S) as client,
    ):
        yield Monitor(rig, client)
