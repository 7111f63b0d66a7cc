"""The exporter with something in every family, and the names and labels of its series."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import msgspec
import yaml

import trocar.protocol.bodies as bodies
from tests.supervisor.made_up import health, histogram, loop_report
from trocar.protocol import PROCESSES
from trocar.services.diagnosis.thread_usage import Counts, UsageRow
from trocar.services.runtime.config.config import load_rig
from trocar.services.runtime.config.rig import PATH_OWNERS
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.measures.stage_times import StageTimes
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.metrics import Level, RigCollector, RigSource
from trocar.services.supervisor.page.task_metrics import Task

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "deploy" / "monitoring"
DASHBOARDS = sorted((FOLDER / "grafana" / "dashboards").glob("*.json"))
RULES = sorted((FOLDER / "prometheus" / "rules").glob("*.yml"))
#: What a scrape adds to every series.
OF_SCRAPES = frozenset({"job", "instance", "rig"})
IN_FULL = "In full"
_KINDS = ("arm", "grasp")
_NAME = re.compile(r"\b(trocar[_:][\w:]+)(?:\{([^}]*)\})?")
_LABEL = re.compile(r"(\w+)\s*(?:=~|!~|!=|=)")


def attempt(**given: object) -> bodies.Attempt:
    settled = {"begins": 0, "attempt_id": "a", "state": "running", "phase": "P3", "depth_m": 0.01, **given}
    return bodies.Attempt(**settled)  # type: ignore[arg-type]


def _stage() -> bodies.StageCost:
    meter = LoopMeter(1000.0, ("solve",))
    times = StageTimes(meter.flight)
    for k in range(100):
        meter.flight.write(k, 0, 0, 0, 0, (200_000,))
    [stage] = times.take()
    return stage


def whole_rig() -> RigSource:
    """Return a rig whose every process, path, device and observer has said something."""
    topic = bodies.TopicReport(
        topic="gateway.state", sent=9, received=100, dropped=2, refused={"flood": 3}, age=histogram([50_000] * 100)
    )
    heard = {}
    for name in PROCESSES:
        paths = tuple(
            bodies.PathLatency(name=path, latency=histogram([300_000] * 99 + [1_500_000]))
            for path, owner in PATH_OWNERS.items()
            if owner == name
        )
        gauges = {
            "gateway": {f"device_link_up.{side}.{kind}": 1.0 for side in ("left", "right") for kind in _KINDS},
            "recorder": {"recorded_frames": 9.0, "lost_frames": 1.0, "waiting_for_disk_bytes": 5.0,
                         "disk_free_bytes": 1e10},
        }.get(name, {"resets": 1.0})  # fmt: skip
        body = health(name, loop=loop_report(1000, misses=7, skipped=3), paths=paths, topics=(topic,), gauges=gauges)
        heard[name] = msgspec.structs.replace(body, stages=(_stage(),))
    reports = tuple(bodies.ProcessReport(name=name, state="ready") for name in PROCESSES if name != "supervisor")
    quality = bodies.QualityReport(cost_us=300.0, force_error_percent=1.0, motion_error_percent=2.0)
    state = bodies.SupervisorState(state=RigState.RUNNING, processes=reports, quality=quality)
    threads = {name: UsageRow(Counts(name, "", 5, 2, 10**9, 10**8), None) for name in PROCESSES}
    task = Task()
    task.see(attempt())
    return RigSource(state, heard, threads, True, load_rig("stub").contracts, task)


def exported(level: Level) -> dict[str, frozenset[str]]:
    """Return the labels of every series by its name; a family without a series has no labels."""
    found: dict[str, frozenset[str]] = {}
    for family in RigCollector(whole_rig, level).collect():
        if not family.samples:
            found[f"{family.name}{'_total' if family.type == 'counter' else ''}"] = frozenset()
        for sample in family.samples:
            found[sample.name] = frozenset(sample.labels)
    return found


def recorded() -> dict[str, str]:
    """Return the expression of every recording rule by its name."""
    groups = [group for file in RULES for group in yaml.safe_load(file.read_text())["groups"]]
    return {rule["record"]: rule["expr"] for group in groups for rule in group["rules"] if "record" in rule}


def alerts() -> dict[str, str]:
    groups = [group for file in RULES for group in yaml.safe_load(file.read_text())["groups"]]
    return {rule["alert"]: rule["expr"] for group in groups for rule in group["rules"] if "alert" in rule}


def panels(file: Path) -> Iterator[tuple[str, str, str]]:
    """Yield row, title and expression of every query of a dashboard, its notes and variables among them."""
    dashboard, row = json.loads(file.read_text()), ""
    for panel in dashboard["panels"]:
        row = panel["title"] if panel["type"] == "row" else row
        for target in panel.get("targets", ()):
            yield row, panel["title"], target["expr"]
    for note in dashboard.get("annotations", {}).get("list", ()):
        yield "", note["name"], note["expr"]
    for variable in dashboard.get("templating", {}).get("list", ()):
        yield "", variable["name"], variable["query"].removeprefix("label_values(").rpartition(",")[0]


def named(expression: str) -> Iterator[tuple[str, set[str]]]:
    """Yield the names of this project's series in an expression, with the labels that are asked of each."""
    for name, matchers in _NAME.findall(expression):
        yield name, set(_LABEL.findall(matchers))
