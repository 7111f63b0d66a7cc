"""Configuration and rules by Prometheus' own tool, and that each alert is told of in a test of the rules."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator

import prometheus_client
import pytest
import yaml

from tests.monitoring.exporter import DASHBOARDS, FOLDER, RULES, alerts, panels, recorded

PROMTOOL = shutil.which("promtool")
needs_promtool = pytest.mark.skipif(PROMTOOL is None, reason="promtool is not installed (Debian: prometheus)")
HERE = FOLDER / "prometheus"
TESTS = sorted(HERE.glob("rules*_test.yml"))


def _promtool(*arguments: str) -> str:
    assert PROMTOOL is not None
    done = subprocess.run([PROMTOOL, *arguments], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@needs_promtool
def test_prometheus_takes_the_configuration() -> None:
    assert "SUCCESS" in _promtool("check", "config", str(HERE / "prometheus.yml"))


@needs_promtool
def test_rules_have_no_lint() -> None:
    _promtool("check", "rules", "--lint=all", "--lint-fatal", *map(str, RULES))


@needs_promtool
def test_rules_do_as_their_tests_say() -> None:
    assert _promtool("test", "rules", *map(str, TESTS)).count("SUCCESS") == len(TESTS) == 2


def test_of_each_alert_it_is_told_what_to_do() -> None:
    told = (FOLDER.parent / "README.md").read_text()
    assert [name for name in alerts() if name not in told] == []


def test_of_each_alert_it_is_tested_when_it_comes_and_when_it_does_not() -> None:
    tests = [test for path in TESTS for test in yaml.safe_load(path.read_text())["tests"]]
    cases = [case for test in tests for case in test["alert_rule_test"]]
    assert {case["alertname"] for case in cases if case.get("exp_alerts")} == alerts().keys()
    assert {case["alertname"] for case in cases if not case.get("exp_alerts")} == alerts().keys()


def _expressions() -> Iterator[tuple[str, str]]:
    yield from {**recorded(), **alerts()}.items()
    for file in DASHBOARDS:
        yield from ((title, expression) for _, title, expression in panels(file))


_SECONDS = {"s": 1, "m": 60, "h": 3600, "d": 86400}


def test_every_range_holds_four_scrapes_at_least() -> None:
    """Since Prometheus 3 a range leaves its oldest moment out, and with it a sample of those that hold two."""
    interval = yaml.safe_load((HERE / "prometheus.yml").read_text())["global"]["scrape_interval"]
    scrape_s = int(interval[:-1]) * _SECONDS[interval[-1]]
    for name, expression in _expressions():
        for number, unit in re.findall(r"\[(\d+)([smhd])", expression):
            assert int(number) * _SECONDS[unit] >= 4 * scrape_s, f"{name}: {expression}"


def test_expressions_mean_the_same_to_prometheus_2_and_3() -> None:
    """Of 3: a dot matches line ends, `le` and `quantile` are floats, holt_winters has another name."""
    for name, expression in _expressions():
        assert not re.search(r"""[=!]~\s*"[^"]*(?<!\\)\.[^"]*\"""", expression), name
        assert not re.search(r"""\b(le|quantile)\s*=~?\s*"\d+\"""", expression), name
        assert "holt_winters" not in expression, name


def test_what_is_exported_has_a_type_that_prometheus_3_reads() -> None:
    """It no longer guesses: an answer of another type is a failed scrape."""
    kind, _, rest = prometheus_client.CONTENT_TYPE_LATEST.partition(";")
    assert kind == "text/plain"
    assert dict(each.strip().split("=") for each in rest.split(";"))["version"] in ("0.0.4", "1.0.0")
