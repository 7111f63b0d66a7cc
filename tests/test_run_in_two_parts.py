"""The test command: what runs in which part, and that no failure of either is lost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests import file_seconds
from tests.__main__ import Outcome, exit_code, measure_rates, run_part, summary

SUITE = """
import pytest

def test_good(): pass

@pytest.mark.skip
def test_not_here(): pass

def test_bad(): assert {bad}
"""


def _outcome(code: int) -> Outcome:
    return Outcome(code, passed=2, failed=0, skipped=1, elapsed_s=3.0)


@pytest.mark.parametrize(
    ("codes", "expected"),
    [((0, 0), 0), ((1, 0), 1), ((0, 1), 1), ((0, 5), 0), ((5, 0), 0), ((5, 5), 5), ((5, 1), 1), ((-9, 0), -9)],
)
def test_either_part_fails_the_run_and_one_without_tests_does_not(codes: tuple[int, int], expected: int) -> None:
    assert exit_code([_outcome(code) for code in codes]) == expected


def test_totals_are_of_both_parts() -> None:
    expected = "all tests: 4 passed, 0 failed, 2 skipped in 6 s (3 + 3)"
    assert summary([_outcome(0), _outcome(0)]) == expected


@pytest.mark.parametrize("options", [(), ("-n", "1")])
def test_a_part_is_counted(options: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "test_suite.py").write_text(SUITE.format(bad="False"))
    part = run_part((*options, "-q", "-c", "/dev/null", "--rootdir", str(tmp_path)), [str(tmp_path)])
    assert (part.exit_code, part.passed, part.failed, part.skipped) == (1, 1, 1, 1)
    [told] = part.failures
    assert "test_bad" in told
    assert "assert False" in told
    assert list(part.file_s) == ["test_suite"]


def test_files_that_took_longest_begin_first_the_next_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = ["tests/files/test_trusted_path.py", "tests/protocol/test_topics.py"]

    def order() -> list[str]:
        command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-n0", *files]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return list(dict.fromkeys(line.partition("::")[0] for line in done.stdout.splitlines() if "::" in line))

    monkeypatch.delenv(file_seconds.COPY, raising=False)  # that of the run which this is part of
    monkeypatch.setenv("TROCAR_CACHE_DIR", str(tmp_path))
    file_seconds.keep_seconds({"tests.protocol.test_topics": 3.0, "tests.gone": 9.0})
    file_seconds.keep_seconds({"tests.files.test_trusted_path": 2.0})
    assert order() == files, "as it is asked for, of whoever runs a few"
    monkeypatch.setenv(file_seconds.COPY, str(tmp_path / "test-seconds.json"))
    assert order() == files[::-1]
    (tmp_path / "test-seconds.json").write_text("{")
    assert order() == files
    assert file_seconds.longest({"tests.a": 1.0, "tests.b": 2.4}) == "longest files: b 2 s, a 1 s"


def test_what_starts_a_rig_is_in_the_second_part_and_nothing_else() -> None:
    command = [sys.executable, "-m", "tests", "--collect-only", "-q", "tests/rig/test_two_hosts.py"]
    done = subprocess.run([*command, "tests/protocol/test_topics.py"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    first, _, second = done.stdout.partition("deselected")
    assert "test_topics" in first
    assert "test_two_hosts" not in first
    assert "test_two_hosts" in second
    assert "test_topics" not in second


def test_what_the_long_run_starts_after_the_tests_can_be_started(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of its modules named another that was gone: the run of hours ended with an error."""
    run, asked = subprocess.run, []

    def run_help(command: list[str], *, check: bool) -> subprocess.CompletedProcess[str]:
        asked.append(run([*command, "--help"], check=check, capture_output=True, text=True))
        return asked[-1]

    monkeypatch.setattr(subprocess, "run", run_help)
    assert measure_rates(seed=1) == 0
    assert all("usage" in each.stdout.lower() for each in asked)
