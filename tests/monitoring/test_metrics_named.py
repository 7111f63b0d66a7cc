"""What dashboards, rules and alerts name is what the exporter has, at the level at which it is scraped."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import prometheus_client
import pytest
import yaml

import trocar.protocol.bodies as bodies
from tests.monitoring.exporter import (
    DASHBOARDS,
    FOLDER,
    IN_FULL,
    OF_SCRAPES,
    alerts,
    attempt,
    exported,
    named,
    panels,
    recorded,
    whole_rig,
)
from trocar.services.supervisor.page.metrics import registry
from trocar.services.supervisor.page.task_metrics import Task, families


def _expressions() -> Iterator[tuple[str, str, str]]:
    for where, found in (("rule", recorded()), ("alert", alerts())):
        yield from ((where, name, expression) for name, expression in found.items())
    for file in DASHBOARDS:
        for row, title, expression in panels(file):
            yield "full" if row.startswith(IN_FULL) else "panel", f"{file.stem}: {title}", expression


@pytest.mark.parametrize(("where", "name", "expression"), [*_expressions()], ids=lambda value: str(value)[:40])
def test_every_metric_that_is_named_exists_with_its_labels(where: str, name: str, expression: str) -> None:
    known = exported("full" if where == "full" else "summary")
    rules = recorded()
    for metric, labels in named(expression):
        if metric in rules:
            of = frozenset().union(*(known[each] for each, _ in named(rules[metric])))
        else:
            assert metric in known, f"{name}: nobody exports {metric}"
            of = known[metric]
        assert labels <= of | OF_SCRAPES, f"{name}: {metric} has no label {labels - of - OF_SCRAPES}"


def test_names_that_nobody_exports_would_be_found() -> None:
    known = exported("full")
    assert {name for name, _ in named("rate(trocar_loop_ticks[5m]) / on (x) trocar_safe_stop")} - known.keys() == {
        "trocar_loop_ticks"
    }
    assert dict(named('trocar_service_up{service="a", state!="b"}')) == {"trocar_service_up": {"service", "state"}}


def test_the_summary_has_at_most_200_series_and_the_whole_has_all_of_it() -> None:
    texts = {
        level: prometheus_client.generate_latest(registry(whole_rig, level)).decode() for level in ("summary", "full")
    }
    series = {level: {line.rpartition(" ")[0] for line in text.splitlines() if line[0] != "#"}
              for level, text in texts.items()}  # fmt: skip
    assert len(series["summary"]) <= 200
    assert len(series["full"]) > 1000
    assert series["summary"] <= series["full"]


def test_a_scrape_is_of_the_summary_unless_it_asks_for_more() -> None:
    jobs = yaml.safe_load((FOLDER / "prometheus" / "prometheus.yml").read_text())["scrape_configs"]
    assert [job["params"] for job in jobs] == [{"level": ["summary"]}]


@pytest.mark.parametrize(
    ("reports", "ended"),
    [
        ([attempt(), attempt(state="done", outcome="success")], {"success": 1}),
        ([attempt(), *[attempt(state="done", outcome="failure")] * 2], {"failure": 1}),
        ([attempt(), attempt(state="abandoned"), attempt(attempt_id="b", state="armed")], {"abandoned": 1}),
        ([attempt(), attempt(attempt_id="b", state="armed")], {"abandoned": 1}),  # its last word was not heard
        ([attempt(state="armed"), attempt(attempt_id="b", state="armed")], {}),  # nobody had moved
        ([attempt(state="done", outcome="success")], {}),  # ended before anybody looked
        ([attempt(), attempt(state="done", outcome="mad")], {}),
    ],
)  # fmt: skip
def test_attempts_are_counted_as_they_end(reports: list[bodies.Attempt], ended: dict[str, int]) -> None:
    task = Task()
    for report in reports:
        task.see(report)
    assert +task.ended == ended


def test_errors_are_counted_over_attempts_and_never_fall() -> None:
    task, seen = Task(), []
    for report in (
        attempt(errors={"E1": 1}), attempt(errors={"E1": 3, "E4": 1}), attempt(errors={"E1": 3, "E4": 1}),
        attempt(attempt_id="b", errors={"E1": 2, "unheard of": 5}),
    ):  # fmt: skip
        task.see(report)
        seen.append(task.errors["E1"])
    assert seen == [1, 3, 3, 5]
    assert task.errors["E4"] == 1
    exported_codes = {s.labels["code"] for f in families(task) for s in f.samples if f.name == "trocar_attempt_errors"}
    assert exported_codes == {f"E{k}" for k in range(1, 15)}


def test_without_an_attempt_its_gauges_are_absent_and_counts_are_there_from_the_start() -> None:
    values = {sample.name: sample.value for family in families(Task()) for sample in family.samples}
    assert set(values) == {"trocar_attempts_total", "trocar_attempt_errors_total"}
    assert set(values.values()) == {0.0}


def test_dashboards_are_three() -> None:
    assert [Path(file).stem for file in DASHBOARDS] == ["attempt", "classroom", "rig"]
