"""Configuration and rules by Prometheus' own tool, and that each alert is told of in a test of the rules."""

from __future__ import annotations

import shutil
import subprocess

import pytest
import yaml

from tests.monitoring.exporter import FOLDER, RULES, alerts

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
